#include "algorithms/cores/td3_core.h"

#include "algorithms/base/metrics.h"
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

void AddMetrics(const Td3Metrics& values, MetricMeans& metrics) {
  metrics.Add("critic_loss", values.critic_loss);
  metrics.Add("mean_q", values.mean_q);
  metrics.Add("mean_target", values.mean_target);
  const size_t count = values.actor_step ? 1 : 0;  // means are over the actor's steps
  metrics.AddAll("actor_loss", {&values.actor_loss, count});
  if (values.bc_loss) metrics.AddAll("bc_loss", {&*values.bc_loss, count});
  if (values.lambda) metrics.AddAll("lambda", {&*values.lambda, count});
}

template <typename Scalar>
Result<Td3Core<Scalar>> Td3Core<Scalar>::Create(const Td3Options& options) {
  B4MRL_RETURN_IF_ERROR(Validate(options));
  return Td3Core(options);
}

template <typename Scalar>
Td3Core<Scalar>::Td3Core(const Td3Options& options)
    : options_(options),
      actor_({.shape = ActorShape(options, options.action_size),
              .learning_rate = options.actor_learning_rate,
              .batch_max = options.batch_max,
              .precision = options.precision,
              .has_target = true,
              .weights = {Rng(options.seed, "td3-actor-weights")}}),
      critics_(options, {Rng(options.seed, "td3-critic-weights")}),
      first_critic_workspace_(critics_.layout,
                              {.batch_max = options.batch_max, .precision = options.precision}),
      noise_(options.action_size, options.batch_max),
      action_gradient_(options.action_size, options.batch_max) {
  if (options.bc_alpha) metrics_.bc_loss = metrics_.lambda = 0;
}

template <typename Scalar>
Td3Metrics Td3Core<Scalar>::Update(const TransitionBatch<Scalar>& batch,
                                   MatrixView<const Scalar> noise) {
  if (noise.columns == 0) noise = DrawNoise(batch.size());
  ++updates_;
  metrics_.actor_step = updates_ % options_.policy_frequency == 0;
  ComputeTargets(batch, noise);
  UpdateCritics(batch, metrics_.actor_step);
  if (metrics_.actor_step) UpdateActor(batch);
  return metrics_;
}

template <typename Scalar>
MatrixView<const Scalar> Td3Core<Scalar>::DrawNoise(int n) {
  Rng rng(options_.seed, "td3-noise", static_cast<uint64_t>(updates_));
  rng.FillNormal(noise_.view(n).values());
  return noise_.view(n);
}

template <typename Scalar>
void Td3Core<Scalar>::ComputeTargets(const TransitionBatch<Scalar>& batch,
                                     MatrixView<const Scalar> noise) {
  const MatrixView<Scalar> input = critics_.input.view(batch.size());  // to become (s', a')
  const MatrixView<Scalar> next_actions =
      input.RowBlock(options_.observation_size, options_.action_size);
  CopyMatrix<Scalar>(batch.next_observations, input.RowBlock(0, options_.observation_size));
  TanhForward<Scalar>(actor_.ForwardTarget(batch.next_observations), next_actions);
  const Scalar deviation = static_cast<Scalar>(options_.policy_noise);
  const Scalar clip = static_cast<Scalar>(options_.noise_clip);
  EigenMap<Scalar> actions = ToEigen(next_actions);
  actions.array() += (deviation * ToEigen(noise).array()).max(-clip).min(clip);
  actions = actions.array().max(Scalar(-1)).min(Scalar(1)).matrix();
  metrics_.mean_target =
      BellmanTargets<Scalar>(critics_.ForwardTarget(input), batch.rewards, batch.not_terminated,
                             static_cast<Scalar>(options_.gamma), {}, Scalar(0), critics_.targets);
}

template <typename Scalar>
void Td3Core<Scalar>::UpdateCritics(const TransitionBatch<Scalar>& batch, bool delayed_step) {
  const MatrixView<Scalar> q = critics_.Evaluate(batch.observations, batch.actions);
  const CriticLoss loss = SquaredErrorToTargets<Scalar>(q, critics_.targets, Scalar(1),
                                                        critics_.workspace.output_gradient());
  metrics_.critic_loss = loss.loss;
  metrics_.mean_q = loss.mean_q;
  critics_.Backward(critics_.input.view(batch.size()));
  // A delayed step also updates the target critics, in one pass: nothing reads them before the
  // next update.
  if (delayed_step) {
    critics_.StepWithTarget(options_.tau);
  } else {
    critics_.Step();
  }
}

template <typename Scalar>
void Td3Core<Scalar>::UpdateActor(const TransitionBatch<Scalar>& batch) {
  const int n = batch.size();
  MlpWorkspace<Scalar>& first_critic = first_critic_workspace_;
  const MatrixView<Scalar> input = critics_.input.view(n);  // still holds the batch's observations
  const MatrixView<Scalar> actions =
      input.RowBlock(options_.observation_size, options_.action_size);
  TanhForward<Scalar>(actor_.Forward(batch.observations), actions);
  const MatrixView<Scalar> q =
      MlpForward<Scalar>(critics_.layout, critics_.values, input, first_critic);
  const std::span<const Scalar> values(q.data, n);  // one row
  const double mean_q = Mean<Scalar>(values);
  if (options_.bc_alpha) metrics_.lambda = *options_.bc_alpha / MeanMagnitude<Scalar>(values);
  const double lambda = metrics_.lambda.value_or(1);
  ToEigen(first_critic.output_gradient()).setConstant(static_cast<Scalar>(-lambda / n));
  const MatrixView<Scalar> gradient = action_gradient_.view(n);
  MlpBackwardToInput<Scalar>(critics_.layout, critics_.values, options_.observation_size,
                             first_critic, gradient);
  if (options_.bc_alpha) {
    metrics_.bc_loss = AddMeanSquaredError<Scalar>(actions, batch.actions, gradient);
  }
  metrics_.actor_loss = -lambda * mean_q + metrics_.bc_loss.value_or(0);
  TanhBackward<Scalar>(actions, gradient, actor_.workspace.output_gradient());
  actor_.Backward(batch.observations);
  actor_.StepWithTarget(options_.tau);
}

template <typename Scalar>
PolicyWeights Td3Core<Scalar>::Policy() const {
  return ActorWeights<Scalar>(actor_, options_.action_size);
}

template class Td3Core<float>;
template class Td3Core<double>;

}  // namespace b4mrl
