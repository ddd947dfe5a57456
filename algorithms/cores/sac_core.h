// Soft actor-critic: the networks, their optimisers and one gradient step on a given batch.
//
// Haarnoja et al., "Soft actor-critic algorithms and applications" (2018), in the order of
// operations of Stable-Baselines3:
//   1. a, log pi(a|s) from the actor;         alpha = exp(log_alpha), fixed for this step
//   2. log_alpha:  L = -mean(log_alpha (log pi + target_entropy))
//   3. y = r + not_terminated gamma (min Q'(s', a') - alpha log pi(a'|s'))
//   4. critics:    L = 1/2 sum_k mean (Q_k(s, a) - y)^2
//   5. actor:      L = mean(alpha log pi - min_k Q_k(s, a)), with the critics of step 4
//   6. Q' <- tau Q + (1 - tau) Q'
// Steps 1, 2 and 5 are SoftActor's (soft_actor.h), which H2O shares. Data, replay, exploration and
// schedules belong to the learner that owns a core. MOPO and HyMOPO train the same core on other
// batches. Allocates nothing of its own after construction. Thread rule: one thread.
#pragma once

#include <cstdint>

#include "algorithms/cores/actor_critic.h"
#include "algorithms/cores/soft_actor.h"
#include "algorithms/cores/transition_batch.h"
#include "algorithms/policy/inference.h"
#include "proto/base/status.h"

namespace b4mrl {

template <typename Scalar>
class SacCore : public TrainedParts<SacCore<Scalar>, Scalar> {
 public:
  static Result<SacCore> Create(const SacOptions& options);

  // One gradient step on n transitions, 1 <= n <= batch_max. `noise`: standard normals, action x 2
  // n, in the layout of SoftActor::DrawNoise; drawn if empty.
  SacMetrics Update(const TransitionBatch<Scalar>& batch, MatrixView<const Scalar> noise = {});

  const SacOptions& options() const { return options_; }
  int64_t updates() const { return updates_; }
  PolicyWeights Policy() const { return actor_.Policy(); }

  template <typename Body>
  void ForEachPart(Body body) {
    body("updates", updates_);
    actor_.ForEachPart(body);
    body("critic", critics_);
  }

 private:
  explicit SacCore(const SacOptions& options);

  void ComputeTargets(const TransitionBatch<Scalar>& batch, SacMetrics& metrics);
  void UpdateCritics(const TransitionBatch<Scalar>& batch, SacMetrics& metrics);

  SacOptions options_;
  int64_t updates_ = 0;
  SoftActor<Scalar> actor_;
  TwinCritics<Scalar> critics_;
};

extern template class SacCore<float>;
extern template class SacCore<double>;

}  // namespace b4mrl
