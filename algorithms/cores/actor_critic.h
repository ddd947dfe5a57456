// Parts that the actor-critic cores share: common options, twin critics, and an actor's weights as
// a policy.
//
// Every core has one Update(batch, noise): one gradient step of all its networks. `noise` holds the
// step's standard normals, which tests give. Without `noise` they are a function of the core's seed
// and the number of the update, so a resumed run needs that number alone.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "algorithms/nn/network.h"
#include "algorithms/policy/inference.h"
#include "proto/base/status.h"

namespace b4mrl {

struct ActorCriticOptions {
  int observation_size = 0;
  int action_size = 0;
  std::vector<int> hidden = {256, 256};  // widths of the hidden layers of the actor and each critic
  int batch_max = 256;                   // largest batch of an update, in transitions
  double actor_learning_rate = 3e-4;
  double critic_learning_rate = 3e-4;
  double gamma = 0.99;  // discount
  double tau = 0.005;   // Polyak rate: target <- tau * online + (1 - tau) * target
  uint64_t seed = 0;    // of the initial weights and of the updates' noise
  int threads = 1;      // threads that evaluate the twin critics; their number changes no bit
  Precision precision = Precision::kFp32;  // of products between two hidden layers
};

Status ValidateSizes(int observation_size, int action_size, const std::vector<int>& hidden,
                     int batch_max);
Status ValidateActorCritic(const ActorCriticOptions& options);
Status ValidateRate(std::string_view name, double value);          // finite and >= 0
Status ValidateUnitInterval(std::string_view name, double value);  // in [0, 1]

// Shape of an actor network, from an observation to `outputs` numbers.
MlpShape ActorShape(const ActorCriticOptions& options, int outputs);

// Q_1 and Q_2, the two members of one network from (s, a) to a value, with their target networks
// Q'_1 and Q'_2.
// Thread rule: one thread.
template <typename Scalar>
struct TwinCritics : Network<Scalar> {
  TwinCritics(const ActorCriticOptions& options, const InitialWeights& weights);

  // Evaluate the critics, and their targets, at n pairs (s, a): 2 x n values. Leave the pairs in
  // `input`.
  MatrixView<Scalar> Evaluate(MatrixView<const Scalar> observations,
                              MatrixView<const Scalar> actions) {
    return Network<Scalar>::Forward(Stack(observations, actions));
  }
  MatrixView<Scalar> EvaluateTargets(MatrixView<const Scalar> observations,
                                     MatrixView<const Scalar> actions) {
    return Network<Scalar>::ForwardTarget(Stack(observations, actions));
  }
  // Writes `input`: each column holds s, then a.
  MatrixView<const Scalar> Stack(MatrixView<const Scalar> observations,
                                 MatrixView<const Scalar> actions);
  // One Adam step of the critics from workspace.output_gradient() of the n pairs evaluated last,
  // then one Polyak step of their targets.
  void Train(int n, double tau) {
    Network<Scalar>::Backward(input.view(n));
    Network<Scalar>::StepWithTarget(tau);
  }

  MatrixBuffer<Scalar> input;     // observation + action x batch
  AlignedVector<Scalar> targets;  // batch: y of the core's Bellman equation
};

// The actor's weights as a policy: its output layer becomes the mean head or, if it has 2 *
// action_size outputs, the mean and log_std heads.
template <typename Scalar>
PolicyWeights ActorWeights(const Network<Scalar>& actor, int action_size);

extern template struct TwinCritics<float>;
extern template struct TwinCritics<double>;

}  // namespace b4mrl
