// An agent's observation mask, a number for each dimension of one observation: 1 where its training
// showed the dimension, 0 where it was hidden. Empty when no dimension was hidden.
#pragma once

#include <fmt/format.h>

#include <cstdint>
#include <vector>

#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

// The mask of a session, from its perturbations in parametric form: "hidden" with the argument
// "9+10" or with dimension names.
inline Result<std::vector<float>> MaskOfPerturbations(
    const SpaceSpec& observation, const std::vector<NamedArgument>& perturbations) {
  std::vector<float> mask;
  for (const NamedArgument& perturbation : perturbations) {
    if (perturbation.name != "hidden") continue;
    B4MRL_ASSIGN_OR_RETURN(const std::vector<uint32_t> dimensions,
                           observation.ParseDimensions(perturbation.argument));
    mask.resize(observation.size(), 1.0f);
    for (const uint32_t dimension : dimensions) mask[dimension] = 0;
  }
  return mask;
}

// The mask of an opened dataset, from the hidden dimensions that the daemon reports for it.
// kInternal if the observation has not all of them.
template <typename Dimensions>
Result<std::vector<float>> MaskOfDimensions(size_t observation_size, const Dimensions& hidden) {
  std::vector<float> mask;
  for (const uint32_t dimension : hidden) {
    if (dimension >= observation_size) {
      return Status(
          StatusCode::kInternal,
          fmt::format("the server's reply hides dimension {} of {}", dimension, observation_size));
    }
    mask.resize(observation_size, 1.0f);
    mask[dimension] = 0;
  }
  return mask;
}

}  // namespace b4mrl
