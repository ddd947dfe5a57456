#include "algorithms/episodes/behaviour.h"

#include <fmt/format.h>

#include <algorithm>
#include <numbers>

namespace b4mrl {

Status CheckSizes(const AgentPolicy& policy, const EnvironmentSpec& environment) {
  return environment.CheckSizes("the agent", static_cast<uint64_t>(policy.observation_size()),
                                static_cast<uint64_t>(policy.action_size()));
}

Behaviour::Behaviour(std::optional<AgentPolicy> policy, const EnvironmentSpec& environment)
    : policy_(std::move(policy)),
      observation_size_(static_cast<int>(environment.observation.size())),
      action_scale_(environment.ActionScale()) {}

Result<Behaviour> Behaviour::OfAgent(const Agent& agent, const EnvironmentSpec& environment) {
  B4MRL_ASSIGN_OR_RETURN(AgentPolicy policy, AgentPolicy::Create(agent));
  B4MRL_RETURN_IF_ERROR(CheckSizes(policy, environment));
  if (!policy.stochastic()) {
    return InvalidArgument("agent", "deterministic",
                           "one with a stochastic policy (tanh_gaussian), such as SAC's");
  }
  return Behaviour(std::move(policy), environment);
}

Behaviour Behaviour::Uniform(const EnvironmentSpec& environment) {
  return Behaviour(std::nullopt, environment);
}

void Behaviour::Draw(Rng& rng, std::span<float> draws) const {
  if (policy_) return rng.FillNormal(draws);
  for (float& draw : draws) draw = static_cast<float>(rng.Uniform(-1, 1));
}

void Behaviour::Act(MatrixView<const float> histories, MatrixView<const float> draws,
                    MatrixView<float> actions, std::span<float> log_probs) const {
  if (policy_) return policy_->Sample(histories, draws, actions, log_probs);
  for (int lane = 0; lane < actions.columns; ++lane) {
    for (int i = 0; i < actions.rows; ++i) {
      actions(i, lane) = draws(i, lane) * action_scale_[static_cast<size_t>(i)];
    }
  }
  // The density of a uniform action in [-1, 1] is 1/2 in every dimension.
  std::ranges::fill(log_probs, static_cast<float>(-std::numbers::ln2 * action_size()));
}

}  // namespace b4mrl
