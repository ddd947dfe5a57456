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
// pi(s) = tanh of the actor network: the action of either actor, and the mean of the Gaussian one.
// Its deviations sigma = exp(clamp(log_std)) do not depend on s, and the Gaussian is not squashed.
// iql-pytorch's deterministic actor has as many outputs again, which nothing reads; they are left
// out.
//
// An update draws no random numbers. Allocates nothing of its own after construction. Thread rule:
// one thread.
#pragma once

#include <cstdint>

#include "algorithms/cores/actor_critic.h"
#include "algorithms/cores/transition_batch.h"
#include "algorithms/nn/adam.h"
#include "algorithms/nn/mlp.h"
#include "algorithms/nn/weighted_losses.h"
#include "algorithms/policy/inference.h"
#include "proto/base/status.h"

namespace b4mrl {

enum class IqlActor { kDeterministic, kGaussian };
enum class IqlInitialization {
  kTorch,       // PyTorch's default, as the other cores have it
  kOrthogonal,  // with gain sqrt(2) and zero biases, as the authors' code has it
};

struct IqlOptions : ActorCriticOptions {
  IqlActor actor = IqlActor::kDeterministic;
  IqlInitialization initialization = IqlInitialization::kTorch;
  double value_learning_rate = 3e-4;
  // The actor's learning rate falls to 0 along half a cosine over so many updates and stays there;
  // 0: it is constant.
  int64_t cosine_updates = 1'000'000;
  double expectile = 0.7;
  double temperature = 3;  // inverse: 0 clones every action alike
  double weight_max = 100;
  LogStdRange log_std;  // of the Gaussian actor
};

struct IqlMetrics {
  double value_loss = 0;
  double actor_loss = 0;
  double critic_loss = 0;
  double mean_value = 0;   // V(s) of step 2
  double mean_weight = 0;  // w
  double mean_q = 0;       // of both critics on the batch
  double mean_target = 0;  // y
};

template <typename Scalar>
class IqlCore {
 public:
  static Result<IqlCore> Create(const IqlOptions& options);

  // One gradient step; 1 <= batch.size() <= batch_max.
  IqlMetrics Update(const TransitionBatch<Scalar>& batch);

  const IqlOptions& options() const { return options_; }
  int64_t updates() const { return updates_; }
  // Of the next update.
  double actor_learning_rate() const;

  // pi for the fixed-order inference; without deviations, since an agent file's stochastic policies
  // are squashed and this Gaussian is not.
  PolicyWeights Policy() const;

  // All state, for checkpoints and tests: see nn/parameters.h.
  void VisitArrays(const ArrayVisitor<Scalar>& visitor);
  void VisitCounters(const CounterVisitor& visitor);
  // Gradients of the last update, under the names of the parameters; for tests.
  void VisitGradients(const ArrayVisitor<Scalar>& visitor);

 private:
  explicit IqlCore(const IqlOptions& options);

  // The lines of the legend, in this order.
  void EvaluateTargetCritics(const TransitionBatch<Scalar>& batch);
  void UpdateValue(const TransitionBatch<Scalar>& batch, IqlMetrics& metrics);
  void UpdateActor(const TransitionBatch<Scalar>& batch, IqlMetrics& metrics);
  void UpdateCritics(const TransitionBatch<Scalar>& batch, IqlMetrics& metrics);

  IqlOptions options_;
  int64_t updates_ = 0;
  MlpLayout value_layout_;
  MlpLayout actor_layout_;
  MlpLayout critic_layout_;  // two members
  AlignedVector<Scalar> value_, value_gradient_;
  AlignedVector<Scalar> actor_, actor_gradient_;
  AlignedVector<Scalar> log_std_, log_std_gradient_;  // one an action; none if deterministic
  AlignedVector<Scalar> critic_, critic_gradient_, critic_target_;
  Adam<Scalar> value_adam_, actor_adam_, log_std_adam_, critic_adam_;

  MlpWorkspace<Scalar> value_workspace_;  // after step 1: V(s), then V(s')
  MlpWorkspace<Scalar> actor_workspace_;
  MlpWorkspace<Scalar> critic_workspace_;
  MatrixBuffer<Scalar> value_input_;      // observation x 2 batch: s, then s'
  MatrixBuffer<Scalar> critic_input_;     // observation + action x batch: (s, a)
  MatrixBuffer<Scalar> actions_;          // action x batch: pi(s)
  MatrixBuffer<Scalar> action_gradient_;  // action x batch
  AlignedVector<Scalar> target_q_;        // batch: q
  AlignedVector<Scalar> weights_;         // batch: w
  AlignedVector<Scalar> targets_;         // batch: y
};

extern template class IqlCore<float>;
extern template class IqlCore<double>;

}  // namespace b4mrl
