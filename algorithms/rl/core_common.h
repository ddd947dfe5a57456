// What the cores share: validation of their options, and an actor's weights as a policy. Internal
// to rl/.
#pragma once

#include <span>
#include <string_view>
#include <vector>

#include "algorithms/nn/inference.h"
#include "algorithms/nn/mlp.h"
#include "proto/base/status.h"

namespace b4mrl {

Status ValidateSizes(int observation_size, int action_size, const std::vector<int>& hidden,
                     int batch_max);
Status ValidateRate(std::string_view name, double value);          // finite and >= 0
Status ValidateUnitInterval(std::string_view name, double value);  // in [0, 1]

// The network as one mean head, or, when it has 2 * action_size outputs, as mean and log_std heads.
template <typename Scalar>
PolicyWeights ActorWeights(const MlpLayout& layout, std::span<const Scalar> parameters,
                           int action_size);

}  // namespace b4mrl
