// The stochastic actor of soft actor-critic with its entropy weight, as SAC and H2O train it.
//
// pi(. | s) is a squashed Gaussian (nn/squashed_gaussian.h) whose mean and log_std are the outputs
// of one network. alpha = exp(log_alpha), trained beside pi, weighs the entropy of pi. H2O's actor
// also learns a scale m and an offset b: log_std = clamp(m raw + b), with m = 1 and b = -1 at
// first. Allocates nothing of its own after construction. Thread rule: one thread.
#pragma once

#include <optional>
#include <span>

#include "algorithms/cores/actor_critic.h"
#include "algorithms/cores/transition_batch.h"
#include "algorithms/nn/network.h"
#include "algorithms/nn/squashed_gaussian.h"
#include "algorithms/policy/inference.h"

namespace b4mrl {

class MetricMeans;

struct SacOptions : ActorCriticOptions {
  double alpha_learning_rate = 3e-4;
  double initial_alpha = 1.0;
  std::optional<double> target_entropy;  // in nats; without a value: -action_size
  SquashedGaussianOptions policy;
};

struct SacMetrics {
  double critic_loss = 0;
  double actor_loss = 0;
  double alpha_loss = 0;
  double alpha = 0;        // entropy weight used in this update
  double mean_q = 0;       // mean of Q_1 and Q_2 over the batch
  double mean_target = 0;  // mean of the Bellman targets y
  double entropy = 0;      // -mean log pi(a|s), in nats
};
// Adds SAC's metrics under the names that every learner's logs use for them.
void AddMetrics(const SacMetrics& values, MetricMeans& metrics);

// The differences of H2O's actor from SAC's.
struct SoftActorVariant {
  bool learns_log_std_scale = false;  // whether the actor learns m and b of log_std
  std::optional<double> head_gain;  // the output layer starts as MlpLayout::InitializeHead draws it
};

Status ValidateSac(const SacOptions& options);

template <typename Scalar>
class SoftActor {
 public:
  explicit SoftActor(const SacOptions& options, const SoftActorVariant& variant = {});

  // The standard normals of update number `update`, action x 2 n: columns [0, n) are for a ~ pi(s),
  // [n, 2 n) for a' ~ pi(s'). Valid until the next call.
  MatrixView<const Scalar> DrawNoise(int n, int64_t update);
  // Samples a ~ pi(s) and a' ~ pi(s') with `noise`, in one pass through the network. Writes
  // metrics.entropy.
  void Sample(const TransitionBatch<Scalar>& batch, MatrixView<const Scalar> noise,
              SacMetrics& metrics);
  // Takes alpha for this update, then one step on L = -mean(log_alpha (log pi(a|s) +
  // target_entropy)). Writes metrics.alpha and metrics.alpha_loss.
  void UpdateAlpha(SacMetrics& metrics);
  // One step on L = mean(alpha log pi(a|s) - min_k Q_k(s, a)). Writes metrics.actor_loss.
  void Update(const TransitionBatch<Scalar>& batch, MatrixView<const Scalar> noise,
              TwinCritics<Scalar>& critics, SacMetrics& metrics);

  Scalar alpha() const { return alpha_; }  // as taken by the last UpdateAlpha
  // a' and log pi(a'|s') of the last Sample, whose batch had n transitions.
  MatrixView<const Scalar> next_actions(int n) const {
    return actions_.view(2 * n).ColumnBlock(n, n);
  }
  std::span<const Scalar> next_log_probs(int n) const {
    return std::span<const Scalar>(log_probs_).subspan(n, n);
  }

  // The present actor as weights for the fixed-order inference (policy/inference.h).
  PolicyWeights Policy() const;

  template <typename Body>
  void ForEachPart(Body body) {
    body("actor", network_);
    body("log_alpha", log_alpha_);
  }

 private:
  // Mean and log_std rows for the first `columns` columns of the network's last forward pass.
  MatrixView<const Scalar> Head(int columns);

  SacOptions options_;
  SoftActorVariant variant_;
  Network<Scalar> network_;          // the network's scalars are {m, b}
  TrainedVector<Scalar> log_alpha_;  // of length 1
  Scalar alpha_ = 0;

  // Buffers of one update: columns [0, n) belong to s, columns [n, 2 n) to s'.
  MatrixBuffer<Scalar> input_;            // observation x 2 batch
  MatrixBuffer<Scalar> scaled_head_;      // 2 action x 2 batch: the output with m raw + b
  MatrixBuffer<Scalar> noise_;            // action x 2 batch
  MatrixBuffer<Scalar> actions_;          // action x 2 batch
  AlignedVector<Scalar> log_probs_;       // 2 batch
  MatrixBuffer<Scalar> action_gradient_;  // action x batch
};

extern template class SoftActor<float>;
extern template class SoftActor<double>;

}  // namespace b4mrl
