// The algorithms that `b4mrl train` knows: one line each in list.cc.
#pragma once

#include <memory>
#include <span>
#include <string_view>

#include "algorithms/base/learner.h"

namespace b4mrl {

struct Algorithm {
  std::string_view name;  // "td3-bc"
  std::string_view description;
  LearnerNeeds needs;
  std::span<const Hyperparameter> hyperparameters;
  Result<std::unique_ptr<Learner>> (*create)(const LearnerContext& context);
  // What no range of a single value can say: kInvalidArgument where values do not go together, or
  // not with the environment's sizes. Asks no daemon. nullptr: every combination will do.
  Status (*check)(const LearnerContext& context) = nullptr;
};

std::span<const Algorithm> Algorithms();
// kUnknownName with the nearest known one.
Result<const Algorithm*> FindAlgorithm(std::string_view name);

}  // namespace b4mrl
