// Soft actor-critic: the networks, their optimisers and one gradient step on a given batch.
//
// Haarnoja et al., "Soft actor-critic algorithms and applications" (2018), in the order of
// operations of Stable-Baselines3:
//   1. a, log pi(a|s) from the actor;         alpha = exp(log_alpha), fixed for this step
//   2. log_alpha:  L = -mean(log_alpha (log pi + target_entropy))
//   3. y = r + not_terminated gamma (min Q'(s', a') - alpha log pi(a'|s'))
//   4. critics:    L = critic_loss_scale sum_k mean (Q_k(s, a) - y)^2
//   5. actor:      L = mean(alpha log pi - min_k Q_k(s, a)), with the critics of step 4
//   6. Q' <- tau Q + (1 - tau) Q'
// Data, replay, exploration and schedules belong to the learner that owns a core. MOPO and HyMOPO
// train the same core on other batches. H2O (rl/h2o_core.h) gives step 4 a loss of its own, takes
// step 5 before it, and learns a scale m and an offset b of log_std = clamp(m raw + b).
//
// The update's random numbers are Rng(seed, "sac-noise", update number), so a resumed run needs
// only the counter. Allocates nothing of its own after construction. Thread rule: one thread.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "algorithms/cores/actor_critic.h"
#include "algorithms/cores/transition_batch.h"
#include "algorithms/nn/adam.h"
#include "algorithms/nn/losses.h"
#include "algorithms/nn/mlp.h"
#include "algorithms/nn/squashed_gaussian.h"
#include "algorithms/policy/inference.h"
#include "proto/base/status.h"

namespace b4mrl {

struct SacOptions : ActorCriticOptions {
  double alpha_learning_rate = 3e-4;
  double initial_alpha = 1.0;
  std::optional<double> target_entropy;  // nothing: -action_size
  double critic_loss_scale = 0.5;
  bool entropy_in_target = true;
  bool actor_first = false;          // step 5 before step 4: the critics as they were
  bool learn_log_std_scale = false;  // m = 1 and b = -1 at first; false: they stay 1 and 0
  std::optional<double> head_gain;   // output layers start as MlpLayout::InitializeHead makes them
  SquashedGaussianOptions policy;
};

// A loss of the critics in place of step 4's: returns it and writes d loss / d q, from q (critics x
// n) and y (n).
template <typename Scalar>
using CriticObjective = std::function<CriticLoss(
    MatrixView<const Scalar> q, std::span<const Scalar> targets, MatrixView<Scalar> q_gradient)>;

struct SacMetrics {
  double critic_loss = 0;
  double actor_loss = 0;
  double alpha_loss = 0;
  double alpha = 0;        // used in this update
  double mean_q = 0;       // of both critics on the batch
  double mean_target = 0;  // y
  double entropy = 0;      // -mean log pi(a|s)
};

template <typename Scalar>
class SacCore {
 public:
  static Result<SacCore> Create(const SacOptions& options);

  // One gradient step; 1 <= batch.size() <= batch_max. `objective` empty: the loss of step 4.
  SacMetrics Update(const TransitionBatch<Scalar>& batch,
                    const CriticObjective<Scalar>& objective = {});
  // The same with the standard normals given, action size x batch each: `noise` for a ~ pi(s),
  // `next_noise` for a' ~ pi(s'). Does everything Update does but draw.
  SacMetrics UpdateWithNoise(const TransitionBatch<Scalar>& batch, MatrixView<const Scalar> noise,
                             MatrixView<const Scalar> next_noise,
                             const CriticObjective<Scalar>& objective = {});

  const SacOptions& options() const { return options_; }
  int64_t updates() const { return updates_; }

  // The present actor for the fixed-order inference: what acts, evaluates and goes into files.
  PolicyWeights Policy() const;

  // All state, for checkpoints and tests: see nn/parameters.h.
  void VisitArrays(const ArrayVisitor<Scalar>& visitor);
  void VisitCounters(const CounterVisitor& visitor);
  // Gradients of the last update, under the names of the parameters; for tests.
  void VisitGradients(const ArrayVisitor<Scalar>& visitor);

 private:
  explicit SacCore(const SacOptions& options);

  void InitializeNetworks();
  // Reads noise_: columns [0, n) for a, [n, 2n) for a'.
  SacMetrics UpdateOnNoise(const TransitionBatch<Scalar>& batch,
                           const CriticObjective<Scalar>& objective);
  // The steps of the legend, in this order.
  void SampleActions(const TransitionBatch<Scalar>& batch, SacMetrics& metrics);
  void UpdateAlpha(SacMetrics& metrics);
  void ComputeTargets(const TransitionBatch<Scalar>& batch, SacMetrics& metrics);
  void UpdateCritics(const TransitionBatch<Scalar>& batch, const CriticObjective<Scalar>& objective,
                     SacMetrics& metrics);
  void UpdateActor(const TransitionBatch<Scalar>& batch, SacMetrics& metrics);

  // Writes critic_input_.
  MatrixView<const Scalar> CriticInput(MatrixView<const Scalar> observations,
                                       MatrixView<const Scalar> actions);
  // m and b behind the actor's layers, for one optimiser; empty unless they are learned.
  std::span<Scalar> LogStdScale(std::span<Scalar> actor) const;
  // Mean and log_std rows for s and s', or s alone, from the actor's output.
  MatrixView<const Scalar> PolicyHead(int columns);

  SacOptions options_;
  int64_t updates_ = 0;
  MlpLayout actor_layout_;
  MlpLayout critic_layout_;  // two members
  AlignedVector<Scalar> actor_, actor_gradient_;
  AlignedVector<Scalar> critic_, critic_gradient_, critic_target_;
  AlignedVector<Scalar> log_alpha_, log_alpha_gradient_;  // one number
  Adam<Scalar> actor_adam_, critic_adam_, alpha_adam_;

  // Workspaces. The actor sees s and s' in one pass: columns [0, n) are s, [n, 2n) are s'.
  MlpWorkspace<Scalar> actor_workspace_;
  MlpWorkspace<Scalar> critic_workspace_;
  MatrixBuffer<Scalar> actor_input_;   // observation x 2 batch
  MatrixBuffer<Scalar> critic_input_;  // observation + action x batch
  MatrixBuffer<Scalar> scaled_head_;   // the actor's output with scaled log_std, if that is learned
  MatrixBuffer<Scalar> noise_;         // action x 2 batch
  MatrixBuffer<Scalar> actions_;       // action x 2 batch
  MatrixBuffer<Scalar> action_gradient_;
  AlignedVector<Scalar> log_probs_;  // 2 batch
  AlignedVector<Scalar> targets_;    // batch
  Scalar alpha_ = 0;
};

extern template class SacCore<float>;
extern template class SacCore<double>;

}  // namespace b4mrl
