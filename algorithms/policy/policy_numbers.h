// A policy's layers as one run of numbers, for checkpoints: hidden layers, mean, log_std, each
// weight then bias. Normaliser and mask are not included.
#pragma once

#include <span>
#include <vector>

#include "algorithms/policy/inference.h"

namespace b4mrl {

std::vector<float> FlattenPolicy(const PolicyWeights& policy);
// Into a policy of the same shape; false, changing nothing, when the length does not fit.
bool UnflattenPolicy(std::span<const float> numbers, PolicyWeights& policy);

}  // namespace b4mrl
