#include "algorithms/nn/squashed_gaussian.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <vector>

#include "tests/algorithms/finite_differences.h"

namespace b4mrl {
namespace {

constexpr int kActions = 3;
constexpr int kColumns = 4;

struct Fixture {
  explicit Fixture(const SquashedGaussianOptions& o) : options(o) {
    Rng rng(2, "gaussian-test");
    rng.FillNormal(head.values());
    rng.FillNormal(noise.values());
    rng.FillNormal(weights.values());
  }

  // sum(weights * action) + 0.3 sum(log pi): every path of the backward pass.
  double Loss() {
    SampleSquashedGaussian<double>(options, head.view(), noise.view(), actions.view(), log_probs);
    double sum = 0;
    for (const double log_prob : log_probs) sum += 0.3 * log_prob;
    for (size_t i = 0; i < weights.values().size(); ++i) {
      sum += weights.values()[i] * actions.values()[i];
    }
    return sum;
  }

  SquashedGaussianOptions options;
  MatrixBuffer<double> head{2 * kActions, kColumns}, noise{kActions, kColumns};
  MatrixBuffer<double> weights{kActions, kColumns}, actions{kActions, kColumns};
  std::vector<double> log_probs = std::vector<double>(kColumns);
};

TEST_CASE("gradients of the squashed Gaussian equal finite differences") {
  SquashedGaussianOptions options;
  options.form = GENERATE(LogProbForm::kEpsilon, LogProbForm::kExact);
  options.epsilon = GENERATE(1e-6, 0.1);  // 0.1: large enough that its term matters
  Fixture f(options);
  MatrixBuffer<double> gradient(2 * kActions, kColumns);
  f.Loss();
  SquashedGaussianBackward<double>(options, f.head.view(), f.noise.view(), f.actions.view(),
                                   f.weights.view(), 0.3, gradient.view());
  CheckGradient(f.head.values(), gradient.values(), [&] { return f.Loss(); });
}

TEST_CASE("a clamped log_std passes no gradient") {
  SquashedGaussianOptions options;
  options.log_std_min = -1;
  options.log_std_max = 0.5;
  Fixture f(options);
  f.head.view()(kActions, 0) = -3;
  f.head.view()(kActions + 1, 0) = 2;
  MatrixBuffer<double> gradient(2 * kActions, kColumns);
  f.Loss();
  SquashedGaussianBackward<double>(options, f.head.view(), f.noise.view(), f.actions.view(),
                                   f.weights.view(), 0.3, gradient.view());
  CHECK(gradient.view()(kActions, 0) == 0);
  CHECK(gradient.view()(kActions + 1, 0) == 0);
  CheckGradient(f.head.values(), gradient.values(), [&] { return f.Loss(); });
}

TEST_CASE("the density of the squashed Gaussian integrates to one") {
  SquashedGaussianOptions options;
  options.form = LogProbForm::kExact;
  MatrixBuffer<double> head(2, 1), noise(1, 1), action(1, 1);
  head.view()(0, 0) = 0.4;
  head.view()(1, 0) = -0.3;
  double integral = 0, previous_action = -1, previous_density = 0;
  for (double e = -8; e <= 8; e += 0.001) {
    noise.view()(0, 0) = e;
    double log_prob = 0;
    SampleSquashedGaussian<double>(options, head.view(), noise.view(), action.view(),
                                   {&log_prob, 1});
    const double a = action.view()(0, 0);
    integral += (a - previous_action) * (std::exp(log_prob) + previous_density) / 2;
    previous_action = a;
    previous_density = std::exp(log_prob);
  }
  CHECK(integral == Approx(1).epsilon(1e-5));  // the trapezoid rule's error at this step
}

TEST_CASE("the exact log-density stays finite where tanh saturates") {
  SquashedGaussianOptions options;
  options.form = LogProbForm::kExact;
  MatrixBuffer<float> head(2, 2), noise(1, 2), action(1, 2);
  head.view()(0, 0) = 40;
  head.view()(0, 1) = -40;
  std::vector<float> log_probs(2);
  SampleSquashedGaussian<float>(options, head.view(), noise.view(), action.view(), log_probs);
  // -log(2 pi)/2 - 2 (log 2 - 40)
  CHECK(log_probs[0] == Approx(77.6947).epsilon(1e-5));
  CHECK(log_probs[1] == log_probs[0]);
}

TEST_CASE("columns beyond one strip are sampled like the first ones") {
  const int columns = 1000;
  SquashedGaussianOptions options;
  MatrixBuffer<float> head(2 * kActions, columns), noise(kActions, columns);
  MatrixBuffer<float> actions(kActions, columns);
  std::vector<float> log_probs(columns);
  for (int i = 0; i < columns; ++i) {
    for (int k = 0; k < kActions; ++k) {
      head.view()(k, i) = 0.1f * static_cast<float>(k);
      noise.view()(k, i) = 0.5f;
    }
  }
  SampleSquashedGaussian<float>(options, head.view(), noise.view(), actions.view(), log_probs);
  for (int i = 0; i < columns; ++i) {
    for (int k = 0; k < kActions; ++k) {
      // A strip's last numbers go through the scalar functions: a last bit may differ.
      CHECK(actions.view()(k, i) == Approx(std::tanh(0.1 * k + 0.5)).epsilon(1e-6));
    }
    CHECK(log_probs[i] == Approx(log_probs[0]).epsilon(1e-6));
  }
}

}  // namespace
}  // namespace b4mrl
