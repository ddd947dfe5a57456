// What the actor-critic cores share: the common part of their options, the networks these describe,
// and an actor's weights as a policy.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "algorithms/nn/mlp.h"
#include "algorithms/policy/inference.h"
#include "proto/base/status.h"

namespace b4mrl {

struct ActorCriticOptions {
  int observation_size = 0;
  int action_size = 0;
  std::vector<int> hidden = {256, 256};  // of the actor and of each critic
  int batch_max = 256;
  double actor_learning_rate = 3e-4;
  double critic_learning_rate = 3e-4;
  double gamma = 0.99;
  double tau = 0.005;
  uint64_t seed = 0;  // of the initial weights and of the updates' noise
  int threads = 1;    // of the twin critics; they change no bit
};

Status ValidateSizes(int observation_size, int action_size, const std::vector<int>& hidden,
                     int batch_max);
Status ValidateActorCritic(const ActorCriticOptions& options);
Status ValidateRate(std::string_view name, double value);          // finite and >= 0
Status ValidateUnitInterval(std::string_view name, double value);  // in [0, 1]

MlpLayout ActorLayout(const ActorCriticOptions& options, int outputs);
MlpLayout TwinCriticLayout(const ActorCriticOptions& options);  // two members: Q_1 and Q_2

// The network as one mean head, or, when it has 2 * action_size outputs, as mean and log_std heads.
template <typename Scalar>
PolicyWeights ActorWeights(const MlpLayout& layout, std::span<const Scalar> parameters,
                           int action_size);

}  // namespace b4mrl
