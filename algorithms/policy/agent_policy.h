// From a learner's weights to agent files, and from agent files to actions. The whole chain:
//
//   core.Policy()            the weights of the actor that a core (algorithms/cores) trains
//     -> PolicyWeights       inference.h: plain numbers, from the observations of a history to an
//                            action in [-1, 1]
//        -> FixedOrderPolicy inference.h: computes with them; a learner acts by it while it trains
//        -> Agent            data/d4rl/agent_file.h, by MakeAgent: the network as a file holds it,
//                            with history length, scale of the actions and provenance
//           <-> agent.h5     by WriteAgent and ReadAgent
//           -> AgentPolicy   a FixedOrderPolicy that gives actions in the environment's units:
//                            evaluations, datasets, demos
//
// So every action that makes data or scores goes through the fixed-order inference. A network may
// have any number of hidden layers that an agent file may have. Thread rule: AgentPolicy is
// immutable; any number of threads may share it.
#pragma once

#include <span>
#include <vector>

#include "algorithms/nn/products/view.h"
#include "algorithms/policy/inference.h"
#include "data/d4rl/agent_file.h"
#include "proto/base/status.h"

namespace b4mrl {

// Which dimensions of an observation an evaluated policy sees (`--observe`).
enum class Observe {
  kTrained,  // the dimensions that the policy saw in training; hidden dimensions are zero
  // All dimensions, the hidden ones as the environment gives them: data that hide a dimension say
  // nothing about its scale, and its weights are those of the initialisation.
  kFull,
};

class AgentPolicy {
 public:
  // Errors: those of Agent::Validate and FixedOrderPolicy::Create.
  static Result<AgentPolicy> Create(const Agent& agent, Observe observe = Observe::kTrained);

  int history_length() const { return history_length_; }
  int observation_size() const { return observation_size_; }  // numbers in one observation
  int action_size() const { return network_.action_size(); }
  bool stochastic() const { return network_.stochastic(); }

  // Computes deterministic actions, in the environment's units. Each column of `histories` holds
  // the stacked observations of one lane (observation_history.h).
  void Act(MatrixView<const float> histories, MatrixView<float> actions) const;
  // Computes stochastic actions, in the environment's units, from standard normals `noise` (action
  // x n), and their log densities under the unscaled policy, as rlkit stores them.
  void Sample(MatrixView<const float> histories, MatrixView<const float> noise,
              MatrixView<float> actions, std::span<float> log_probs) const;

 private:
  AgentPolicy(FixedOrderPolicy network, const Agent& agent);
  void Scale(MatrixView<float> actions) const;

  FixedOrderPolicy network_;
  int history_length_;
  int observation_size_;
  std::vector<float> action_scale_;
};

// Makes an agent from a learner's policy, without provenance, which the caller adds. The network's
// input is `history_length` observations of equal mean, std and mask; `action_scale` holds the
// largest action of each dimension in the environment's units.
Agent MakeAgent(const PolicyWeights& weights, uint32_t history_length,
                std::span<const float> action_scale);

}  // namespace b4mrl
