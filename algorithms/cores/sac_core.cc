#include "algorithms/cores/sac_core.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "algorithms/nn/products/eigen_map.h"

namespace b4mrl {
namespace {

Status Validate(const SacOptions& options) {
  B4MRL_RETURN_IF_ERROR(ValidateActorCritic(options));
  B4MRL_RETURN_IF_ERROR(ValidateRate("alpha_learning_rate", options.alpha_learning_rate));
  if (!(options.initial_alpha > 0) || !std::isfinite(options.initial_alpha)) {
    return InvalidNumber("initial_alpha", options.initial_alpha, "a finite number above 0");
  }
  return {};
}

// m and b, at the end so that everything before them keeps its place.
int64_t ActorSize(const SacOptions& options, const MlpLayout& layout) {
  return layout.size() + (options.learn_log_std_scale ? 2 : 0);
}

}  // namespace

template <typename Scalar>
Result<SacCore<Scalar>> SacCore<Scalar>::Create(const SacOptions& options) {
  B4MRL_RETURN_IF_ERROR(Validate(options));
  return SacCore(options);
}

template <typename Scalar>
SacCore<Scalar>::SacCore(const SacOptions& options)
    : options_(options),
      actor_layout_(ActorLayout(options, 2 * options.action_size)),
      critic_layout_(TwinCriticLayout(options)),
      actor_(ActorSize(options, actor_layout_)),
      actor_gradient_(actor_.size()),
      critic_(critic_layout_.size()),
      critic_gradient_(critic_layout_.size()),
      log_alpha_(1, static_cast<Scalar>(std::log(options.initial_alpha))),
      log_alpha_gradient_(1),
      actor_adam_({.learning_rate = options.actor_learning_rate}, std::ssize(actor_)),
      critic_adam_({.learning_rate = options.critic_learning_rate}, critic_layout_.size()),
      alpha_adam_({.learning_rate = options.alpha_learning_rate}, 1),
      actor_workspace_(actor_layout_, 1, 2 * options.batch_max),
      critic_workspace_(critic_layout_, 2, options.batch_max, options.threads),
      actor_input_(options.observation_size, 2 * options.batch_max),
      critic_input_(options.observation_size + options.action_size, options.batch_max),
      scaled_head_(2 * options.action_size,
                   options.learn_log_std_scale ? 2 * options.batch_max : 0),
      noise_(options.action_size, 2 * options.batch_max),
      actions_(options.action_size, 2 * options.batch_max),
      action_gradient_(options.action_size, options.batch_max),
      log_probs_(2 * static_cast<size_t>(options.batch_max)),
      targets_(options.batch_max) {
  InitializeNetworks();
}

template <typename Scalar>
void SacCore<Scalar>::InitializeNetworks() {
  Rng actor_rng(options_.seed, "sac-actor-weights");
  Rng critic_rng(options_.seed, "sac-critic-weights");
  actor_layout_.Initialize<Scalar>(Initialization::kTorchUniform, actor_rng, actor_);
  critic_layout_.Initialize<Scalar>(Initialization::kTorchUniform, critic_rng, critic_);
  if (options_.head_gain) {
    actor_layout_.InitializeHead<Scalar>(*options_.head_gain, actor_rng, actor_);
    critic_layout_.InitializeHead<Scalar>(*options_.head_gain, critic_rng, critic_);
  }
  if (options_.learn_log_std_scale) {
    LogStdScale(actor_)[0] = 1;
    LogStdScale(actor_)[1] = -1;
  }
  critic_target_ = critic_;
}

template <typename Scalar>
std::span<Scalar> SacCore<Scalar>::LogStdScale(std::span<Scalar> actor) const {
  return actor.subspan(actor_layout_.size());
}

template <typename Scalar>
MatrixView<const Scalar> SacCore<Scalar>::PolicyHead(int columns) {
  if (!options_.learn_log_std_scale) return actor_workspace_.output().ColumnBlock(0, columns);
  return scaled_head_.view(columns);
}

template <typename Scalar>
MatrixView<const Scalar> SacCore<Scalar>::CriticInput(MatrixView<const Scalar> observations,
                                                      MatrixView<const Scalar> actions) {
  const MatrixView<Scalar> input = critic_input_.view(observations.columns);
  StackRows<Scalar>({observations, actions}, input);
  return input;
}

template <typename Scalar>
SacMetrics SacCore<Scalar>::Update(const TransitionBatch<Scalar>& batch,
                                   const CriticObjective<Scalar>& objective) {
  const MatrixView<Scalar> noise = noise_.view(2 * batch.size());
  Rng rng(options_.seed, "sac-noise", static_cast<uint64_t>(updates_));
  rng.FillNormal(noise.values());
  return UpdateOnNoise(batch, objective);
}

template <typename Scalar>
SacMetrics SacCore<Scalar>::UpdateWithNoise(const TransitionBatch<Scalar>& batch,
                                            MatrixView<const Scalar> noise,
                                            MatrixView<const Scalar> next_noise,
                                            const CriticObjective<Scalar>& objective) {
  const int n = batch.size();
  CopyMatrix<Scalar>(noise, noise_.view(n));
  CopyMatrix<Scalar>(next_noise, noise_.view(2 * n).ColumnBlock(n, n));
  return UpdateOnNoise(batch, objective);
}

template <typename Scalar>
SacMetrics SacCore<Scalar>::UpdateOnNoise(const TransitionBatch<Scalar>& batch,
                                          const CriticObjective<Scalar>& objective) {
  SacMetrics metrics;
  SampleActions(batch, metrics);
  UpdateAlpha(metrics);
  ComputeTargets(batch, metrics);
  if (options_.actor_first) UpdateActor(batch, metrics);
  UpdateCritics(batch, objective, metrics);
  if (!options_.actor_first) UpdateActor(batch, metrics);
  ++updates_;
  return metrics;
}

template <typename Scalar>
void SacCore<Scalar>::SampleActions(const TransitionBatch<Scalar>& batch, SacMetrics& metrics) {
  const int n = batch.size();
  const MatrixView<Scalar> input = actor_input_.view(2 * n);
  CopyMatrix<Scalar>(batch.observations, input.ColumnBlock(0, n));
  CopyMatrix<Scalar>(batch.next_observations, input.ColumnBlock(n, n));
  const MatrixView<Scalar> head =
      MlpForward<Scalar>(actor_layout_, actor_, input, actor_workspace_);
  if (options_.learn_log_std_scale) {
    ScaleLogStd<Scalar>(head, LogStdScale(actor_), scaled_head_.view(2 * n));
  }
  SampleSquashedGaussian<Scalar>(options_.policy, PolicyHead(2 * n), noise_.view(2 * n),
                                 actions_.view(2 * n), log_probs_);
  metrics.entropy = -Mean<Scalar>(std::span<const Scalar>(log_probs_).first(n));
}

template <typename Scalar>
void SacCore<Scalar>::UpdateAlpha(SacMetrics& metrics) {
  alpha_ = std::exp(log_alpha_[0]);
  metrics.alpha = alpha_;
  const double target_entropy =
      options_.target_entropy.value_or(-static_cast<double>(options_.action_size));
  const double gradient = metrics.entropy - target_entropy;
  metrics.alpha_loss = gradient * log_alpha_[0];
  log_alpha_gradient_[0] = static_cast<Scalar>(gradient);
  alpha_adam_.Step(log_alpha_, log_alpha_gradient_);
}

template <typename Scalar>
void SacCore<Scalar>::ComputeTargets(const TransitionBatch<Scalar>& batch, SacMetrics& metrics) {
  const int n = batch.size();
  const MatrixView<const Scalar> input =
      CriticInput(batch.next_observations, actions_.view(2 * n).ColumnBlock(n, n));
  const MatrixView<Scalar> q =
      MlpForward<Scalar>(critic_layout_, critic_target_, input, critic_workspace_);
  const std::span<const Scalar> next_log_probs =
      std::span<const Scalar>(log_probs_).subspan(n, options_.entropy_in_target ? n : 0);
  BellmanTargets<Scalar>(q, batch.rewards, batch.not_terminated,
                         static_cast<Scalar>(options_.gamma), next_log_probs, alpha_, targets_);
  metrics.mean_target = Mean<Scalar>(std::span<const Scalar>(targets_).first(n));
}

template <typename Scalar>
void SacCore<Scalar>::UpdateCritics(const TransitionBatch<Scalar>& batch,
                                    const CriticObjective<Scalar>& objective, SacMetrics& metrics) {
  const MatrixView<const Scalar> input = CriticInput(batch.observations, batch.actions);
  const MatrixView<Scalar> q =
      MlpForward<Scalar>(critic_layout_, critic_, input, critic_workspace_);
  const std::span<const Scalar> targets = std::span<const Scalar>(targets_).first(batch.size());
  const MatrixView<Scalar> gradient = critic_workspace_.output_gradient();
  const CriticLoss loss =
      objective ? objective(q, targets, gradient)
                : SquaredErrorToTargets<Scalar>(
                      q, targets, static_cast<Scalar>(options_.critic_loss_scale), gradient);
  metrics.critic_loss = loss.loss;
  metrics.mean_q = loss.mean_q;
  MlpBackward<Scalar>(critic_layout_, critic_, input, critic_workspace_, critic_gradient_);
  // Step 6 rides along: nothing reads the target critics before the next update.
  critic_adam_.StepWithPolyak(critic_, critic_gradient_, options_.tau, critic_target_);
}

template <typename Scalar>
void SacCore<Scalar>::UpdateActor(const TransitionBatch<Scalar>& batch, SacMetrics& metrics) {
  const int n = batch.size();
  const MatrixView<const Scalar> actions = actions_.view(n);
  const MatrixView<const Scalar> critic_input = CriticInput(batch.observations, actions);
  const MatrixView<Scalar> q =
      MlpForward<Scalar>(critic_layout_, critic_, critic_input, critic_workspace_);
  const double mean_minimum = MeanMinimum<Scalar>(q, critic_workspace_.output_gradient());
  metrics.actor_loss = -alpha_ * metrics.entropy - mean_minimum;
  MlpBackward<Scalar>(critic_layout_, critic_, critic_input, critic_workspace_, {});
  MlpInputGradient<Scalar>(critic_layout_, critic_, options_.observation_size, critic_workspace_,
                           action_gradient_.view(n));

  actor_workspace_.batch = n;  // of the 2 n columns only those of s have a gradient
  const MatrixView<Scalar> head_gradient = actor_workspace_.output_gradient();
  SquashedGaussianBackward<Scalar>(options_.policy, PolicyHead(n), noise_.view(n), actions,
                                   action_gradient_.view(n), alpha_ / static_cast<Scalar>(n),
                                   head_gradient);
  if (options_.learn_log_std_scale) {
    ScaleLogStdBackward<Scalar>(actor_workspace_.output(), LogStdScale(actor_), head_gradient,
                                LogStdScale(actor_gradient_));
  }
  MlpBackward<Scalar>(actor_layout_, actor_, actor_input_.view(n), actor_workspace_,
                      actor_gradient_);
  actor_adam_.Step(actor_, actor_gradient_);
}

template <typename Scalar>
PolicyWeights SacCore<Scalar>::Policy() const {
  PolicyWeights weights = ActorWeights<Scalar>(actor_layout_, actor_, options_.action_size);
  if (options_.learn_log_std_scale) {
    // The head's last layer takes m and b in, so that an agent's file needs no word of them.
    const float m = static_cast<float>(actor_[actor_layout_.size()]);
    const float b = static_cast<float>(actor_[actor_layout_.size() + 1]);
    for (float& weight : weights.log_std->weight) weight *= m;
    for (float& bias : weights.log_std->bias) bias = m * bias + b;
  }
  weights.log_std_min = static_cast<float>(options_.policy.log_std_min);
  weights.log_std_max = static_cast<float>(options_.policy.log_std_max);
  return weights;
}

template <typename Scalar>
void SacCore<Scalar>::VisitArrays(const ArrayVisitor<Scalar>& visitor) {
  actor_layout_.Visit<Scalar>("actor", actor_, visitor);
  if (options_.learn_log_std_scale) visitor({"actor/log_std_scale", {2}, LogStdScale(actor_)});
  critic_layout_.Visit<Scalar>("critic", critic_, visitor);
  critic_layout_.Visit<Scalar>("critic_target", critic_target_, visitor);
  visitor({"log_alpha", {1}, log_alpha_});
  actor_adam_.Visit("actor/adam", visitor);
  critic_adam_.Visit("critic/adam", visitor);
  alpha_adam_.Visit("log_alpha/adam", visitor);
}

template <typename Scalar>
void SacCore<Scalar>::VisitCounters(const CounterVisitor& visitor) {
  visitor({"updates", &updates_});
  actor_adam_.VisitCounters("actor/adam", visitor);
  critic_adam_.VisitCounters("critic/adam", visitor);
  alpha_adam_.VisitCounters("log_alpha/adam", visitor);
}

template <typename Scalar>
void SacCore<Scalar>::VisitGradients(const ArrayVisitor<Scalar>& visitor) {
  actor_layout_.Visit<Scalar>("actor", actor_gradient_, visitor);
  if (options_.learn_log_std_scale) {
    visitor({"actor/log_std_scale", {2}, LogStdScale(actor_gradient_)});
  }
  critic_layout_.Visit<Scalar>("critic", critic_gradient_, visitor);
  visitor({"log_alpha", {1}, log_alpha_gradient_});
}

template class SacCore<float>;
template class SacCore<double>;

}  // namespace b4mrl
