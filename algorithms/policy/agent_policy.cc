#include "algorithms/policy/agent_policy.h"

#include <utility>

namespace b4mrl {
namespace {

DenseWeights ToDense(const AgentLayer& layer) {
  return {static_cast<int>(layer.inputs), static_cast<int>(layer.outputs), layer.weight,
          layer.bias};
}

AgentLayer ToLayer(const DenseWeights& dense) {
  return {static_cast<uint32_t>(dense.inputs), static_cast<uint32_t>(dense.outputs), dense.weight,
          dense.bias};
}

// Repeats the numbers of one observation for every place of the history.
std::vector<float> Repeat(const std::vector<float>& values, uint32_t times) {
  std::vector<float> repeated;
  for (uint32_t i = 0; i < times; ++i)
    repeated.insert(repeated.end(), values.begin(), values.end());
  return repeated;
}

std::vector<float> FirstPlace(const std::vector<float>& repeated, uint32_t times) {
  return {repeated.begin(),
          repeated.begin() + static_cast<std::ptrdiff_t>(repeated.size() / times)};
}

// A learner that normalises has seen a hidden dimension as the constant 0, with the standard
// deviation 0.001 that it adds to all. Divided by this, the first sight would be a thousand times
// too large.
void ShowHidden(Agent* agent) {
  for (size_t i = 0; i < agent->observation_mask.size(); ++i) {
    if (agent->observation_mask[i] != 0) continue;
    agent->observation_mask[i] = 1;
    agent->observation_mean[i] = 0;
    agent->observation_std[i] = 1;
  }
}

}  // namespace

AgentPolicy::AgentPolicy(FixedOrderPolicy network, const Agent& agent)
    : network_(std::move(network)),
      history_length_(static_cast<int>(agent.history_length)),
      observation_size_(static_cast<int>(agent.observation_dimensions)),
      action_scale_(agent.action_scale) {}

Result<AgentPolicy> AgentPolicy::Create(const Agent& given, Observe observe) {
  B4MRL_RETURN_IF_ERROR(given.Validate());
  Agent agent = given;
  agent.FillDefaults();
  if (observe == Observe::kFull) ShowHidden(&agent);
  PolicyWeights weights;
  weights.hidden_tanh = agent.nonlinearity == Nonlinearity::kTanh;
  weights.observation_size = static_cast<int>(agent.observation_dimensions * agent.history_length);
  weights.action_size = static_cast<int>(agent.action_dimensions);
  for (const AgentLayer& layer : agent.hidden) weights.hidden.push_back(ToDense(layer));
  weights.mean = ToDense(agent.last_fc);
  if (agent.last_fc_log_std) weights.log_std = ToDense(*agent.last_fc_log_std);
  weights.observation_mean = Repeat(agent.observation_mean, agent.history_length);
  weights.observation_std = Repeat(agent.observation_std, agent.history_length);
  const std::vector<float> mask(agent.observation_mask.begin(), agent.observation_mask.end());
  weights.observation_mask = Repeat(mask, agent.history_length);
  B4MRL_ASSIGN_OR_RETURN(FixedOrderPolicy network, FixedOrderPolicy::Create(weights));
  return AgentPolicy(std::move(network), agent);
}

void AgentPolicy::Scale(MatrixView<float> actions) const {
  for (int column = 0; column < actions.columns; ++column) {
    for (int row = 0; row < actions.rows; ++row) actions(row, column) *= action_scale_[row];
  }
}

void AgentPolicy::Act(MatrixView<const float> histories, MatrixView<float> actions) const {
  network_.Act(histories, actions);
  Scale(actions);
}

void AgentPolicy::Sample(MatrixView<const float> histories, MatrixView<const float> noise,
                         MatrixView<float> actions, std::span<float> log_probs) const {
  network_.Sample(histories, noise, actions, log_probs);
  Scale(actions);
}

Agent MakeAgent(const PolicyWeights& weights, uint32_t history_length,
                std::span<const float> action_scale) {
  Agent agent;
  agent.observation_dimensions = static_cast<uint32_t>(weights.observation_size) / history_length;
  agent.action_dimensions = static_cast<uint32_t>(weights.action_size);
  agent.history_length = history_length;
  agent.nonlinearity = weights.hidden_tanh ? Nonlinearity::kTanh : Nonlinearity::kRelu;
  for (const DenseWeights& layer : weights.hidden) agent.hidden.push_back(ToLayer(layer));
  agent.last_fc = ToLayer(weights.mean);
  agent.output_distribution = OutputDistribution::kTanh;
  if (weights.log_std) {
    agent.last_fc_log_std = ToLayer(*weights.log_std);
    agent.output_distribution = OutputDistribution::kTanhGaussian;
  }
  agent.observation_mean = FirstPlace(weights.observation_mean, history_length);
  agent.observation_std = FirstPlace(weights.observation_std, history_length);
  for (const float seen : FirstPlace(weights.observation_mask, history_length)) {
    agent.observation_mask.push_back(seen != 0 ? 1 : 0);
  }
  agent.action_scale.assign(action_scale.begin(), action_scale.end());
  agent.FillDefaults();
  return agent;
}

}  // namespace b4mrl
