#include "algorithms/cores/td3_core.h"

#include <algorithm>
#include <cmath>

#include "algorithms/nn/losses.h"
#include "algorithms/nn/products/eigen_map.h"
#include "algorithms/nn/squashed_gaussian.h"

namespace b4mrl {
namespace {

Status Validate(const Td3Options& options) {
  B4MRL_RETURN_IF_ERROR(ValidateActorCritic(options));
  B4MRL_RETURN_IF_ERROR(ValidateRate("policy_noise", options.policy_noise));
  B4MRL_RETURN_IF_ERROR(ValidateRate("noise_clip", options.noise_clip));
  if (options.policy_frequency < 1) {
    return InvalidNumber("policy_frequency", options.policy_frequency, "at least 1");
  }
  if (options.bc_alpha) return ValidateRate("bc_alpha", *options.bc_alpha);
  return {};
}

}  // namespace

template <typename Scalar>
Result<Td3Core<Scalar>> Td3Core<Scalar>::Create(const Td3Options& options) {
  B4MRL_RETURN_IF_ERROR(Validate(options));
  return Td3Core(options);
}

template <typename Scalar>
Td3Core<Scalar>::Td3Core(const Td3Options& options)
    : options_(options),
      actor_layout_(ActorLayout(options, options.action_size)),
      critic_layout_(TwinCriticLayout(options)),
      actor_(actor_layout_.size()),
      actor_gradient_(actor_layout_.size()),
      critic_(critic_layout_.size()),
      critic_gradient_(critic_layout_.size()),
      actor_adam_({.learning_rate = options.actor_learning_rate}, actor_layout_.size()),
      critic_adam_({.learning_rate = options.critic_learning_rate}, critic_layout_.size()),
      actor_workspace_(actor_layout_, 1, options.batch_max),
      critic_workspace_(critic_layout_, 2, options.batch_max, options.threads),
      first_critic_workspace_(critic_layout_, 1, options.batch_max),
      critic_input_(options.observation_size + options.action_size, options.batch_max),
      noise_(options.action_size, options.batch_max),
      action_gradient_(options.action_size, options.batch_max),
      targets_(options.batch_max) {
  Rng actor_rng(options.seed, "td3-actor-weights");
  Rng critic_rng(options.seed, "td3-critic-weights");
  actor_layout_.Initialize<Scalar>(Initialization::kTorchUniform, actor_rng, actor_);
  critic_layout_.Initialize<Scalar>(Initialization::kTorchUniform, critic_rng, critic_);
  actor_target_ = actor_;
  critic_target_ = critic_;
  if (options.bc_alpha) metrics_.bc_loss = metrics_.lambda = 0;
}

template <typename Scalar>
Td3Metrics Td3Core<Scalar>::Update(const TransitionBatch<Scalar>& batch) {
  const MatrixView<Scalar> noise = noise_.view(batch.size());
  Rng rng(options_.seed, "td3-noise", static_cast<uint64_t>(updates_));
  rng.FillNormal(noise.values());
  return UpdateWithNoise(batch, noise);
}

template <typename Scalar>
Td3Metrics Td3Core<Scalar>::UpdateWithNoise(const TransitionBatch<Scalar>& batch,
                                            MatrixView<const Scalar> noise) {
  ++updates_;
  metrics_.actor_step = updates_ % options_.policy_frequency == 0;
  ComputeTargets(batch, noise);
  UpdateCritics(batch, metrics_.actor_step);
  if (metrics_.actor_step) UpdateActor(batch);
  return metrics_;
}

template <typename Scalar>
void Td3Core<Scalar>::ComputeTargets(const TransitionBatch<Scalar>& batch,
                                     MatrixView<const Scalar> noise) {
  const int n = batch.size();
  const MatrixView<Scalar> input = critic_input_.view(n);
  const MatrixView<Scalar> next_actions =
      input.RowBlock(options_.observation_size, options_.action_size);
  CopyMatrix<Scalar>(batch.next_observations, input.RowBlock(0, options_.observation_size));
  const MatrixView<Scalar> head =
      MlpForward<Scalar>(actor_layout_, actor_target_, batch.next_observations, actor_workspace_);
  TanhForward<Scalar>(head, next_actions);
  const Scalar deviation = static_cast<Scalar>(options_.policy_noise);
  const Scalar clip = static_cast<Scalar>(options_.noise_clip);
  EigenMap<Scalar> actions = ToEigen(next_actions);
  actions.array() += (deviation * ToEigen(noise).array()).max(-clip).min(clip);
  actions = actions.array().max(Scalar(-1)).min(Scalar(1)).matrix();
  const MatrixView<Scalar> q =
      MlpForward<Scalar>(critic_layout_, critic_target_, input, critic_workspace_);
  BellmanTargets<Scalar>(q, batch.rewards, batch.not_terminated,
                         static_cast<Scalar>(options_.gamma), {}, Scalar(0), targets_);
  metrics_.mean_target = Mean<Scalar>(std::span<const Scalar>(targets_).first(n));
}

template <typename Scalar>
void Td3Core<Scalar>::UpdateCritics(const TransitionBatch<Scalar>& batch, bool delayed_step) {
  const MatrixView<Scalar> input = critic_input_.view(batch.size());
  StackRows<Scalar>({batch.observations, batch.actions}, input);
  const MatrixView<Scalar> q =
      MlpForward<Scalar>(critic_layout_, critic_, input, critic_workspace_);
  const CriticLoss loss =
      SquaredErrorToTargets<Scalar>(q, targets_, Scalar(1), critic_workspace_.output_gradient());
  metrics_.critic_loss = loss.loss;
  metrics_.mean_q = loss.mean_q;
  MlpBackward<Scalar>(critic_layout_, critic_, input, critic_workspace_, critic_gradient_);
  // The targets' move of a delayed step rides along: nothing reads them before the next update.
  if (delayed_step) {
    critic_adam_.StepWithPolyak(critic_, critic_gradient_, options_.tau, critic_target_);
  } else {
    critic_adam_.Step(critic_, critic_gradient_);
  }
}

template <typename Scalar>
void Td3Core<Scalar>::UpdateActor(const TransitionBatch<Scalar>& batch) {
  const int n = batch.size();
  const MatrixView<Scalar> input = critic_input_.view(n);  // its observations are the batch's
  const MatrixView<Scalar> actions =
      input.RowBlock(options_.observation_size, options_.action_size);
  const MatrixView<Scalar> head =
      MlpForward<Scalar>(actor_layout_, actor_, batch.observations, actor_workspace_);
  TanhForward<Scalar>(head, actions);
  const MatrixView<Scalar> q =
      MlpForward<Scalar>(critic_layout_, critic_, input, first_critic_workspace_);
  const std::span<const Scalar> values(q.data, n);  // one row
  const double mean_q = Mean<Scalar>(values);
  if (options_.bc_alpha) metrics_.lambda = *options_.bc_alpha / MeanMagnitude<Scalar>(values);
  const double lambda = metrics_.lambda.value_or(1);
  ToEigen(first_critic_workspace_.output_gradient()).setConstant(static_cast<Scalar>(-lambda / n));
  MlpBackward<Scalar>(critic_layout_, critic_, input, first_critic_workspace_, {});
  const MatrixView<Scalar> gradient = action_gradient_.view(n);
  MlpInputGradient<Scalar>(critic_layout_, critic_, options_.observation_size,
                           first_critic_workspace_, gradient);
  if (options_.bc_alpha) {
    metrics_.bc_loss = AddMeanSquaredError<Scalar>(actions, batch.actions, gradient);
  }
  metrics_.actor_loss = -lambda * mean_q + metrics_.bc_loss.value_or(0);
  TanhBackward<Scalar>(actions, gradient, actor_workspace_.output_gradient());
  MlpBackward<Scalar>(actor_layout_, actor_, batch.observations, actor_workspace_, actor_gradient_);
  actor_adam_.StepWithPolyak(actor_, actor_gradient_, options_.tau, actor_target_);
}

template <typename Scalar>
PolicyWeights Td3Core<Scalar>::Policy() const {
  return ActorWeights<Scalar>(actor_layout_, actor_, options_.action_size);
}

template <typename Scalar>
void Td3Core<Scalar>::VisitArrays(const ArrayVisitor<Scalar>& visitor) {
  actor_layout_.Visit<Scalar>("actor", actor_, visitor);
  actor_layout_.Visit<Scalar>("actor_target", actor_target_, visitor);
  critic_layout_.Visit<Scalar>("critic", critic_, visitor);
  critic_layout_.Visit<Scalar>("critic_target", critic_target_, visitor);
  actor_adam_.Visit("actor/adam", visitor);
  critic_adam_.Visit("critic/adam", visitor);
}

template <typename Scalar>
void Td3Core<Scalar>::VisitCounters(const CounterVisitor& visitor) {
  visitor({"updates", &updates_});
  actor_adam_.VisitCounters("actor/adam", visitor);
  critic_adam_.VisitCounters("critic/adam", visitor);
}

template <typename Scalar>
void Td3Core<Scalar>::VisitGradients(const ArrayVisitor<Scalar>& visitor) {
  actor_layout_.Visit<Scalar>("actor", actor_gradient_, visitor);
  critic_layout_.Visit<Scalar>("critic", critic_gradient_, visitor);
}

template class Td3Core<float>;
template class Td3Core<double>;

}  // namespace b4mrl
