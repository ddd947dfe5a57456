// Twin delayed deep deterministic policy gradient: networks, optimisers and one gradient step, with
// the behaviour-cloning term that makes it TD3-BC.
//
// Fujimoto et al. 2018 (TD3) and Fujimoto and Gu 2021 (TD3-BC), in the order of the authors' code:
//   1. a' = clip(pi'(s') + clip(N(0, policy_noise), +-noise_clip), +-1)
//      y  = r + not_terminated gamma min_k Q'_k(s', a')
//   2. critics: L = sum_k mean (Q_k(s, a) - y)^2
//   3. every `policy_frequency`-th update, counted from 1:
//      TD3:    L = -mean Q_1(s, pi(s))
//      TD3-BC: L = -lambda mean Q_1(s, pi(s)) + mean (pi(s) - a)^2, lambda = bc_alpha / mean|Q_1|
//              as a constant, the second mean over batch and action dimensions
//      then all targets <- tau online + (1 - tau) target
// An update allocates nothing of its own. Thread rule: one thread.
#pragma once

#include <cstdint>
#include <optional>

#include "algorithms/cores/actor_critic.h"
#include "algorithms/cores/transition_batch.h"
#include "algorithms/nn/network.h"
#include "algorithms/policy/inference.h"
#include "proto/base/status.h"

namespace b4mrl {

class MetricMeans;

struct Td3Options : ActorCriticOptions {
  double policy_noise = 0.2;       // standard deviation of the target action's noise
  double noise_clip = 0.5;         // largest magnitude of that noise
  int policy_frequency = 2;        // critic updates per update of the actor and the targets
  std::optional<double> bc_alpha;  // alpha of TD3-BC's lambda (2.5 there); no value: plain TD3
};

struct Td3Metrics {
  double critic_loss = 0;
  double mean_q = 0;        // mean of Q_1 and Q_2 over the batch
  double mean_target = 0;   // mean of the Bellman targets y
  bool actor_step = false;  // whether this update trained the actor
  // Values of the last update that trained the actor; bc_loss and lambda exist for TD3-BC alone.
  double actor_loss = 0;
  std::optional<double> bc_loss;  // mean (pi(s) - a)^2
  std::optional<double> lambda;
};
// Adds TD3's metrics under the names that every learner's logs use for them.
void AddMetrics(const Td3Metrics& values, MetricMeans& metrics);

template <typename Scalar>
class Td3Core : public TrainedParts<Td3Core<Scalar>, Scalar> {
 public:
  static Result<Td3Core> Create(const Td3Options& options);

  // One gradient step on n transitions, 1 <= n <= batch_max. `noise`: the target action's standard
  // normals, action x n; drawn if empty.
  Td3Metrics Update(const TransitionBatch<Scalar>& batch, MatrixView<const Scalar> noise = {});

  const Td3Options& options() const { return options_; }
  int64_t updates() const { return updates_; }

  // The present actor as weights for the fixed-order inference, without observation mean and std,
  // which the learner adds.
  PolicyWeights Policy() const;

  template <typename Body>
  void ForEachPart(Body body) {
    body("updates", updates_);
    body("actor", actor_);
    body("critic", critics_);
  }

 private:
  explicit Td3Core(const Td3Options& options);

  MatrixView<const Scalar> DrawNoise(int n);
  void ComputeTargets(const TransitionBatch<Scalar>& batch, MatrixView<const Scalar> noise);
  void UpdateCritics(const TransitionBatch<Scalar>& batch, bool delayed_step);
  void UpdateActor(const TransitionBatch<Scalar>& batch);

  Td3Options options_;
  int64_t updates_ = 0;
  Network<Scalar> actor_;
  TwinCritics<Scalar> critics_;
  Td3Metrics metrics_;

  MlpWorkspace<Scalar> first_critic_workspace_;  // for passes of Q_1 alone
  MatrixBuffer<Scalar> noise_;                   // action x batch
  MatrixBuffer<Scalar> action_gradient_;         // action x batch
};

extern template class Td3Core<float>;
extern template class Td3Core<double>;

}  // namespace b4mrl
