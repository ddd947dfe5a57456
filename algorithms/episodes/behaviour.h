// Who acts while a dataset is recorded: an agent's stochastic policy, or nobody, and then actions
// are uniformly random.
//
// Actions are a function of stacked observations and of random numbers that the caller draws, one
// for each action dimension, by fixed-order inference (policy/inference.h): equal bits in batches
// of any size. Immutable; any thread.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "algorithms/nn/products/view.h"
#include "algorithms/policy/agent_policy.h"
#include "data/d4rl/agent_file.h"
#include "proto/base/rng.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

// kInvalidArgument when the policy's sizes are not the environment's.
Status CheckSizes(const AgentPolicy& policy, const EnvironmentSpec& environment);

class Behaviour {
 public:
  // kInvalidArgument when the agent is not stochastic or its sizes are not the environment's.
  static Result<Behaviour> OfAgent(const Agent& agent, const EnvironmentSpec& environment);
  // Every action dimension is uniform between minus and plus its largest action.
  static Behaviour Uniform(const EnvironmentSpec& environment);

  // Number of observations that an action depends on.
  int history_length() const { return policy_ ? policy_->history_length() : 1; }
  int observation_size() const { return observation_size_; }
  int action_size() const { return static_cast<int>(action_scale_.size()); }

  // Fills one lane's random numbers of one action.
  void Draw(Rng& rng, std::span<float> draws) const;
  // Computes actions in the environment's units, and their log densities before that scaling, as
  // rlkit stores them. Columns are lanes: stacked observations, draws, actions.
  void Act(MatrixView<const float> histories, MatrixView<const float> draws,
           MatrixView<float> actions, std::span<float> log_probs) const;

 private:
  Behaviour(std::optional<AgentPolicy> policy, const EnvironmentSpec& environment);

  std::optional<AgentPolicy> policy_;
  int observation_size_;
  std::vector<float> action_scale_;
};

}  // namespace b4mrl
