#include "algorithms/nn/gaussian_head.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <vector>

#include "tests/algorithms/finite_differences.h"

namespace b4mrl {
namespace {

constexpr int kOutputs = 3;
constexpr int kColumns = 5;

struct Fixture {
  Fixture() {
    Rng rng(6, "gaussian-head-test");
    rng.FillNormal(output.values());
    rng.FillNormal(targets.values());
    // Raw log-variances well beyond both bounds, too.
    output.view()(kOutputs, 0) = 6;
    output.view()(kOutputs + 1, 0) = -9;
  }

  double Loss() {
    std::fill(bounds_gradient.begin(), bounds_gradient.end(), 0.0);
    return GaussianHeadLoss<double>(output.view(), targets.view(), bounds, gradient.view(),
                                    bounds_gradient);
  }

  MatrixBuffer<double> output{2 * kOutputs, kColumns}, targets{kOutputs, kColumns};
  MatrixBuffer<double> gradient{2 * kOutputs, kColumns};
  std::vector<double> bounds = {0.5, 0.7, 0.2, -4, -3, -5};
  std::vector<double> bounds_gradient = std::vector<double>(2 * kOutputs);
};

TEST_CASE("the Gaussian head's loss has the gradients of its finite differences") {
  Fixture f;
  f.Loss();
  const std::vector<double> gradient(f.gradient.values().begin(), f.gradient.values().end());
  const std::vector<double> bounds_gradient = f.bounds_gradient;
  CheckGradient(
      f.output.values(), gradient, [&] { return f.Loss(); }, 100);
  CheckGradient(f.bounds, bounds_gradient, [&] { return f.Loss(); });
}

TEST_CASE("log-variances stay between their bounds and are unchanged far inside") {
  const std::vector<double> bounds = {20, 20, 20, -20, -20, -20};
  MatrixBuffer<double> raw(kOutputs, 1);
  raw.view()(0, 0) = 1000;
  raw.view()(1, 0) = -1000;
  raw.view()(2, 0) = 0.25;
  BoundLogVariances<double>(bounds, raw.view());
  CHECK(raw.view()(0, 0) == Approx(20));
  CHECK(raw.view()(1, 0) == Approx(-20));
  CHECK(raw.view()(2, 0) == Approx(0.25).epsilon(0).margin(1e-8));  // two tails of exp(-20)
}

TEST_CASE("a sample is the mean plus the noise times the deviation") {
  MatrixBuffer<float> mean(kOutputs, 400), log_var(kOutputs, 400), noise(kOutputs, 400);
  std::fill(log_var.values().begin(), log_var.values().end(), 2 * std::log(3.0f));
  std::fill(mean.values().begin(), mean.values().end(), 1.0f);
  std::fill(noise.values().begin(), noise.values().end(), -0.5f);
  SampleGaussian<float>(mean.view(), log_var.view(), noise.view(), mean.view());
  for (const float sample : mean.values()) CHECK(sample == Approx(-0.5).epsilon(1e-6));
}

}  // namespace
}  // namespace b4mrl
