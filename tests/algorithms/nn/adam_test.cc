#include "algorithms/nn/adam.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <vector>

namespace b4mrl {
namespace {

TEST_CASE("Adam's first step moves each parameter by the learning rate against its gradient") {
  Adam<double> adam(0.1, 3);
  std::vector<double> parameters = {1, 1, 1};
  // Bias correction makes m / sqrt(v) the gradient's sign; epsilon matters only for the tiny one.
  adam.Step(parameters, std::vector<double>{2, -300, 0});
  CHECK(parameters[0] == Approx(0.9));
  CHECK(parameters[1] == Approx(1.1));
  CHECK(parameters[2] == 1);
}

TEST_CASE("Adam's second step follows the formulas") {
  Adam<double> adam(0.1, 1);
  std::vector<double> p = {0};
  adam.Step(p, std::vector<double>{1});
  adam.Step(p, std::vector<double>{-2});
  const double m = 0.9 * 0.1 * 1 + 0.1 * -2;
  const double v = 0.999 * 0.001 * 1 + 0.001 * 4;
  const double step2 = 0.1 / (1 - 0.81) * m / (std::sqrt(v / (1 - 0.999 * 0.999)) + 1e-8);
  CHECK(p[0] == Approx(-0.1 - step2).epsilon(1e-7));  // the first step's epsilon is 1e-8 of it
}

TEST_CASE("a decay range adds its term to the gradient there and nowhere else") {
  Adam<double> with(0.01, 4, {{1, 2, 0.5}});
  Adam<double> without(0.01, 4);
  std::vector<double> a = {3, 4, 5, 6}, b = a;
  with.Step(a, std::vector<double>{0.1, -1.9, 0.1, 0.1});
  without.Step(b, std::vector<double>{0.1, -1.9 + 0.5 * 4, 0.1 + 0.5 * 5, 0.1});
  CHECK(a == b);
}

TEST_CASE("the fused step moves the target towards the new parameters") {
  Adam<double> fused(0.1, 2), plain(0.1, 2);
  std::vector<double> a = {1, -1}, b = a, target = {10, 20};
  const std::vector<double> gradient = {0.3, -0.2};
  fused.StepWithPolyak(a, gradient, 0.25, target);
  plain.Step(b, gradient);
  CHECK(a == b);
  CHECK(target[0] == Approx(0.75 * 10 + 0.25 * b[0]));
  CHECK(target[1] == Approx(0.75 * 20 + 0.25 * b[1]));
}

TEST_CASE("a NaN gradient shows in the parameter") {
  Adam<float> adam(3e-4, 40);
  std::vector<float> parameters(40, 1.0f), gradient(40, 0.5f);
  gradient[17] = std::nanf("");
  adam.Step(parameters, gradient);
  CHECK(std::isnan(parameters[17]));
  CHECK(std::isfinite(parameters[16]));
}

}  // namespace
}  // namespace b4mrl
