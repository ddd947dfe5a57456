#include "algorithms/model/termination.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace b4mrl {

Result<Termination> Termination::Of(const EnvironmentSpec& environment,
                                    std::span<const float> mask) {
  if (!environment.termination) {
    return Status(StatusCode::kUnsupported,
                  fmt::format("an observation of {} does not tell whether its episode ends; the "
                              "catalogue has no termination bounds for it",
                              environment.name));
  }
  std::vector<Bound> bounds;
  for (const DimensionBounds& each : *environment.termination) {
    if (each.dimension >= environment.observation.size()) {
      return Status(StatusCode::kInternal,
                    fmt::format("the catalogue bounds dimension {} of {}, which has {}",
                                each.dimension, environment.name, environment.observation.size()));
    }
    if (!mask.empty() && mask[each.dimension] == 0) continue;
    bounds.push_back({each.dimension, static_cast<float>(each.low), static_cast<float>(each.high),
                      each.inclusive});
  }
  return Termination(std::move(bounds));
}

bool Termination::Ends(std::span<const float> next_observation) const {
  return std::any_of(bounds_.begin(), bounds_.end(), [&](const Bound& bound) {
    const float x = next_observation[bound.dimension];
    const bool healthy =
        bound.inclusive ? x >= bound.low && x <= bound.high : x > bound.low && x < bound.high;
    return !healthy;
  });
}

}  // namespace b4mrl
