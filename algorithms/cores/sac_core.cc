#include "algorithms/cores/sac_core.h"

#include "algorithms/nn/losses.h"

namespace b4mrl {

template <typename Scalar>
Result<SacCore<Scalar>> SacCore<Scalar>::Create(const SacOptions& options) {
  B4MRL_RETURN_IF_ERROR(ValidateSac(options));
  return SacCore(options);
}

template <typename Scalar>
SacCore<Scalar>::SacCore(const SacOptions& options)
    : options_(options),
      actor_(options),
      critics_(options, {Rng(options.seed, "sac-critic-weights")}) {}

template <typename Scalar>
SacMetrics SacCore<Scalar>::Update(const TransitionBatch<Scalar>& batch,
                                   MatrixView<const Scalar> noise) {
  if (noise.columns == 0) noise = actor_.DrawNoise(batch.size(), updates_);
  SacMetrics metrics;
  actor_.Sample(batch, noise, metrics);
  actor_.UpdateAlpha(metrics);
  ComputeTargets(batch, metrics);
  UpdateCritics(batch, metrics);
  actor_.Update(batch, noise, critics_, metrics);
  ++updates_;
  return metrics;
}

template <typename Scalar>
void SacCore<Scalar>::ComputeTargets(const TransitionBatch<Scalar>& batch, SacMetrics& metrics) {
  const int n = batch.size();
  const MatrixView<Scalar> q =
      critics_.EvaluateTargets(batch.next_observations, actor_.next_actions(n));
  metrics.mean_target = BellmanTargets<Scalar>(
      q, batch.rewards, batch.not_terminated, static_cast<Scalar>(options_.gamma),
      actor_.next_log_probs(n), actor_.alpha(), critics_.targets);
}

template <typename Scalar>
void SacCore<Scalar>::UpdateCritics(const TransitionBatch<Scalar>& batch, SacMetrics& metrics) {
  const MatrixView<Scalar> q = critics_.Evaluate(batch.observations, batch.actions);
  const CriticLoss loss = SquaredErrorToTargets<Scalar>(q, critics_.targets, Scalar(0.5),
                                                        critics_.workspace.output_gradient());
  metrics.critic_loss = loss.loss;
  metrics.mean_q = loss.mean_q;
  // Train also does step 6, in one pass: nothing reads the target critics before the next update.
  critics_.Train(batch.size(), options_.tau);
}

template class SacCore<float>;
template class SacCore<double>;

}  // namespace b4mrl
