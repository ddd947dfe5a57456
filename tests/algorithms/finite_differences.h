// Central differences against a gradient computed by hand-written code.
#pragma once

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <functional>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "algorithms/nn/parameters.h"
#include "proto/base/rng.h"

namespace b4mrl {

// Compares gradient[i] with (loss(x + h) - loss(x - h)) / 2h at up to `samples` places of
// `variables`, which `loss` reads and which are as before afterwards. In double with h = 1e-5 the
// difference quotient is right to about 1e-9 (truncation h^2, rounding 1e-16 / h), so 1e-6 of the
// gradient's scale leaves room for strong curvature, not for a wrong term.
inline void CheckGradient(std::span<double> variables, std::span<const double> gradient,
                          const std::function<double()>& loss, int samples = 40) {
  REQUIRE(variables.size() == gradient.size());
  constexpr double kStep = 1e-5;
  double scale = 1e-3;
  for (const double g : gradient) scale = std::max(scale, std::abs(g));
  Rng rng(1, "finite-differences");
  const bool all = variables.size() <= static_cast<size_t>(samples);
  const size_t count = all ? variables.size() : static_cast<size_t>(samples);
  for (size_t n = 0; n < count; ++n) {
    const size_t i = all ? n : rng.Below(variables.size());
    const double saved = variables[i];
    variables[i] = saved + kStep;
    const double above = loss();
    variables[i] = saved - kStep;
    const double below = loss();
    variables[i] = saved;
    INFO("variable " << i);
    CHECK(gradient[i] == Approx((above - below) / (2 * kStep)).epsilon(0).margin(1e-6 * scale));
  }
}

// Checks every gradient of `core` whose name starts with `prefix` against `loss`, which updates the
// core with all learning rates zero: its losses are then functions of its parameters.
template <typename Core>
void CheckGradientsOf(const std::string& prefix, Core& core, const std::function<double()>& loss) {
  loss();
  std::map<std::string, std::vector<double>> gradients;
  core.VisitGradients([&](const NamedArray<double>& array) {
    gradients[array.name].assign(array.values.begin(), array.values.end());
  });
  int checked = 0;
  core.VisitArrays([&](const NamedArray<double>& array) {
    if (!array.name.starts_with(prefix) || !gradients.contains(array.name)) return;
    INFO(array.name);
    CheckGradient(array.values, gradients.at(array.name), loss, 15);
    ++checked;
  });
  CHECK(checked > 0);
}

}  // namespace b4mrl
