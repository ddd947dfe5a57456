#include "algorithms/model/termination.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <utility>

namespace b4mrl {
namespace {

// An open bound with this limit still refuses infinity and NaN.
constexpr float kInfinity = std::numeric_limits<float>::infinity();

}  // namespace

Result<Termination> Termination::Of(const EnvironmentSpec& environment,
                                    std::span<const float> mask) {
  std::vector<Bound> bounds;
  if (environment.name == "Hopper") {
    bounds = {{0, 0.7f, kInfinity}, {1, -0.2f, 0.2f}};
    for (size_t i = 2; i < environment.observation.size(); ++i) {
      bounds.push_back({i, -kInfinity, 100.0f});
    }
  } else if (environment.name == "Walker2d") {
    bounds = {{0, 0.8f, 2.0f}, {1, -1.0f, 1.0f}};
  } else if (environment.name == "Humanoid") {
    bounds = {{0, 1.0f, 2.0f, /*closed=*/true}};
  } else if (environment.name != "HalfCheetah") {
    return Status(
        StatusCode::kUnsupported,
        fmt::format("no rule tells from an observation of {} that its episode ends; there "
                    "are rules for HalfCheetah, Hopper, Walker2d and Humanoid",
                    environment.name));
  }
  if (!mask.empty()) {
    std::erase_if(bounds, [&](const Bound& bound) { return mask[bound.dimension] == 0; });
  }
  return Termination(std::move(bounds));
}

bool Termination::Ends(std::span<const float> next_observation) const {
  return std::any_of(bounds_.begin(), bounds_.end(), [&](const Bound& bound) {
    const float x = next_observation[bound.dimension];
    const bool healthy =
        bound.closed ? x >= bound.low && x <= bound.high : x > bound.low && x < bound.high;
    return !healthy;
  });
}

}  // namespace b4mrl
