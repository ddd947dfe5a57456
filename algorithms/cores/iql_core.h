// Implicit Q-learning: the networks, their optimisers and one gradient step on a given batch.
//
// Kostrikov, Nair and Levine 2021 (IQL), in the order of the authors' code, which its PyTorch
// version iql-pytorch shares. Q' is evaluated once an update:
//      q  = min_k Q'_k(s, a)
//   1. V:       L = mean |expectile - 1(q < V(s))| (q - V(s))^2
//   2. actor:   w = min(exp(temperature (q - V(s))), weight_max), with the V of step 1
//               deterministic: L = mean w (pi(s) - a)^2 over batch and action dimensions
//               Gaussian:      L = -mean w log N(a | pi(s), sigma^2)
//   3. critics: y = r + not_terminated gamma V(s'), with the V of step 1
//               L = sum_k mean (Q_k(s, a) - y)^2
//   4. Q' <- tau Q + (1 - tau) Q'
// pi(s) = tanh of the actor network: the deterministic action, or the mean of the Gaussian actor.
// The Gaussian's standard deviations sigma = exp(clamp(log_std)) do not depend on s, and its
// samples are not squashed. iql-pytorch's deterministic actor has twice as many outputs and reads
// half of them; our actor has no unread outputs.
//
// An update draws no random numbers and allocates nothing of its own. Thread rule: one thread.
#pragma once

#include <cstdint>

#include "algorithms/cores/actor_critic.h"
#include "algorithms/cores/transition_batch.h"
#include "algorithms/nn/network.h"
#include "algorithms/nn/weighted_losses.h"
#include "algorithms/policy/inference.h"
#include "proto/base/status.h"

namespace b4mrl {

class MetricMeans;

enum class IqlActor { kDeterministic, kGaussian };

struct IqlOptions : ActorCriticOptions {
  IqlActor actor = IqlActor::kDeterministic;
  Initialization initialization = Initialization::kTorchUniform;  // authors' code: kOrthogonal
  double value_learning_rate = 3e-4;
  // The number of updates over which the actor's learning rate falls to 0 along half a cosine; it
  // stays 0 after them. 0: the rate is constant.
  int64_t cosine_updates = 1'000'000;
  double expectile = 0.7;
  double temperature = 3;  // inverse temperature; at 0 every action is cloned with weight 1
  double weight_max = 100;
  LogStdRange log_std;  // bounds of the Gaussian actor's log_std
};

struct IqlMetrics {
  double value_loss = 0;
  double actor_loss = 0;
  double critic_loss = 0;
  double mean_value = 0;   // mean of V(s) in step 2
  double mean_weight = 0;  // mean of the actor's weights w
  double mean_q = 0;       // mean of Q_1 and Q_2 over the batch
  double mean_target = 0;  // mean of the Bellman targets y
};
// Adds IQL's metrics under the names that every learner's logs use for them.
void AddMetrics(const IqlMetrics& values, MetricMeans& metrics);

template <typename Scalar>
class IqlCore : public TrainedParts<IqlCore<Scalar>, Scalar> {
 public:
  static Result<IqlCore> Create(const IqlOptions& options);

  // One gradient step on n transitions, 1 <= n <= batch_max.
  IqlMetrics Update(const TransitionBatch<Scalar>& batch);

  const IqlOptions& options() const { return options_; }
  int64_t updates() const { return updates_; }
  // The learning rate that the actor's Adam will have in the next update.
  double actor_learning_rate() const;

  // pi as weights for the fixed-order inference. They lack the Gaussian's standard deviations,
  // since stochastic policies in agent files are squashed and this Gaussian is not.
  PolicyWeights Policy() const;

  template <typename Body>
  void ForEachPart(Body body) {
    body("updates", updates_);
    body("value", value_);
    body("actor", actor_);
    body("critic", critics_);
    body("log_std", log_std_);
  }

 private:
  explicit IqlCore(const IqlOptions& options);

  // The steps of the header comment, in this order: q, then steps 1 to 3; UpdateCritics also
  // does 4.
  void EvaluateTargetCritics(const TransitionBatch<Scalar>& batch);
  void UpdateValue(const TransitionBatch<Scalar>& batch, IqlMetrics& metrics);
  void UpdateActor(const TransitionBatch<Scalar>& batch, IqlMetrics& metrics);
  void UpdateCritics(const TransitionBatch<Scalar>& batch, IqlMetrics& metrics);

  IqlOptions options_;
  int64_t updates_ = 0;
  Network<Scalar> value_;  // after step 1 its workspace has V(s), then V(s')
  Network<Scalar> actor_;
  TrainedVector<Scalar> log_std_;  // one per action dimension; empty if the actor is deterministic
  TwinCritics<Scalar> critics_;

  MatrixBuffer<Scalar> value_input_;      // observation x 2 batch: s, then s'
  MatrixBuffer<Scalar> actions_;          // action x batch: pi(s)
  MatrixBuffer<Scalar> action_gradient_;  // action x batch
  AlignedVector<Scalar> target_q_;        // batch: q
  AlignedVector<Scalar> weights_;         // batch: w
};

extern template class IqlCore<float>;
extern template class IqlCore<double>;

}  // namespace b4mrl
