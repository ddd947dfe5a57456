// From agent files to actions, and from a learner's weights to agent files. Every action that makes
// data or scores goes through AgentPolicy and thereby through the fixed-order inference.
// Thread rule: AgentPolicy is immutable; any number of threads may use one.
#pragma once

#include <span>
#include <string_view>
#include <vector>

#include "algorithms/nn/products/view.h"
#include "algorithms/policy/inference.h"
#include "data/d4rl/agent_file.h"
#include "proto/base/status.h"

namespace b4mrl {

// What an evaluated policy gets to see (`--observe`).
enum class Observe {
  kTrained,  // dimensions hidden in training are zeroed
  kFull,     // everything
};

class AgentPolicy {
 public:
  // kUnsupported for a network that is not ReLU.
  static Result<AgentPolicy> Create(const Agent& agent, Observe observe = Observe::kTrained);

  int history_length() const { return history_length_; }
  int observation_size() const { return observation_size_; }  // of one observation
  int action_size() const { return network_.action_size(); }
  bool stochastic() const { return network_.stochastic(); }

  // histories: stacked observations (observation_history.h), one column a row; actions in the
  // environment's units.
  void Act(MatrixView<const float> histories, MatrixView<float> actions) const;
  // The stochastic action for standard normals `noise` (action x n), and its log density under the
  // unscaled policy, as rlkit stores it.
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

// The inverse: an agent of a learner's policy, provenance left to the caller. The weights' input is
// `history_length` observations of equal mean, std and mask.
Agent MakeAgent(const PolicyWeights& weights, uint32_t history_length,
                std::span<const float> action_scale);

}  // namespace b4mrl
