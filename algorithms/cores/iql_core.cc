#include "algorithms/cores/iql_core.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string_view>

#include "algorithms/nn/losses.h"
#include "algorithms/nn/orthogonal.h"
#include "algorithms/nn/products/eigen_map.h"
#include "algorithms/nn/squashed_gaussian.h"

namespace b4mrl {
namespace {

Status Validate(const IqlOptions& options) {
  B4MRL_RETURN_IF_ERROR(ValidateActorCritic(options));
  B4MRL_RETURN_IF_ERROR(ValidateRate("value_learning_rate", options.value_learning_rate));
  B4MRL_RETURN_IF_ERROR(ValidateUnitInterval("expectile", options.expectile));
  B4MRL_RETURN_IF_ERROR(ValidateRate("temperature", options.temperature));
  B4MRL_RETURN_IF_ERROR(ValidateRate("weight_max", options.weight_max));
  if (options.cosine_updates < 0) {
    return InvalidNumber("cosine_updates", static_cast<double>(options.cosine_updates),
                         "at least 0");
  }
  if (!(options.log_std.low <= options.log_std.high)) {
    return InvalidNumber("log_std.low", options.log_std.low, "at most log_std.high");
  }
  return {};
}

template <typename Scalar>
void InitializeNetwork(const IqlOptions& options, const MlpLayout& layout, std::string_view name,
                       std::span<Scalar> parameters) {
  Rng rng(options.seed, name);
  if (options.initialization == IqlInitialization::kTorch) {
    layout.Initialize<Scalar>(Initialization::kTorchUniform, rng, parameters);
  } else {
    InitializeOrthogonal<Scalar>(layout, std::numbers::sqrt2, rng, parameters);
  }
}

// The first `n` numbers of a network's one output row from `first` on.
template <typename Scalar>
std::span<Scalar> OutputRow(MatrixView<Scalar> row, int first, int n) {
  return {row.data + first, static_cast<size_t>(n)};
}

}  // namespace

template <typename Scalar>
Result<IqlCore<Scalar>> IqlCore<Scalar>::Create(const IqlOptions& options) {
  B4MRL_RETURN_IF_ERROR(Validate(options));
  return IqlCore(options);
}

template <typename Scalar>
IqlCore<Scalar>::IqlCore(const IqlOptions& options)
    : options_(options),
      value_layout_(ActorLayout(options, 1)),  // the actor's shape with one output
      actor_layout_(ActorLayout(options, options.action_size)),
      critic_layout_(TwinCriticLayout(options)),
      value_(value_layout_.size()),
      value_gradient_(value_layout_.size()),
      actor_(actor_layout_.size()),
      actor_gradient_(actor_layout_.size()),
      log_std_(options.actor == IqlActor::kGaussian ? options.action_size : 0),
      log_std_gradient_(log_std_.size()),
      critic_(critic_layout_.size()),
      critic_gradient_(critic_layout_.size()),
      value_adam_({.learning_rate = options.value_learning_rate}, value_layout_.size()),
      actor_adam_({.learning_rate = options.actor_learning_rate}, actor_layout_.size()),
      log_std_adam_({.learning_rate = options.actor_learning_rate},
                    static_cast<int64_t>(log_std_.size())),
      critic_adam_({.learning_rate = options.critic_learning_rate}, critic_layout_.size()),
      value_workspace_(value_layout_, 1, 2 * options.batch_max),
      actor_workspace_(actor_layout_, 1, options.batch_max),
      critic_workspace_(critic_layout_, 2, options.batch_max, options.threads),
      value_input_(options.observation_size, 2 * options.batch_max),
      critic_input_(options.observation_size + options.action_size, options.batch_max),
      actions_(options.action_size, options.batch_max),
      action_gradient_(options.action_size, options.batch_max),
      target_q_(options.batch_max),
      weights_(options.batch_max),
      targets_(options.batch_max) {
  InitializeNetwork<Scalar>(options, value_layout_, "iql-value-weights", value_);
  InitializeNetwork<Scalar>(options, actor_layout_, "iql-actor-weights", actor_);
  InitializeNetwork<Scalar>(options, critic_layout_, "iql-critic-weights", critic_);
  critic_target_ = critic_;
}

template <typename Scalar>
double IqlCore<Scalar>::actor_learning_rate() const {
  if (options_.cosine_updates == 0) return options_.actor_learning_rate;
  const double progress =
      static_cast<double>(updates_) / static_cast<double>(options_.cosine_updates);
  return options_.actor_learning_rate *
         (0.5 + 0.5 * std::cos(std::numbers::pi * std::min(progress, 1.0)));
}

template <typename Scalar>
IqlMetrics IqlCore<Scalar>::Update(const TransitionBatch<Scalar>& batch) {
  IqlMetrics metrics;
  EvaluateTargetCritics(batch);
  UpdateValue(batch, metrics);
  UpdateActor(batch, metrics);
  UpdateCritics(batch, metrics);
  ++updates_;
  return metrics;
}

template <typename Scalar>
void IqlCore<Scalar>::EvaluateTargetCritics(const TransitionBatch<Scalar>& batch) {
  const MatrixView<Scalar> input = critic_input_.view(batch.size());
  StackRows<Scalar>({batch.observations, batch.actions}, input);
  const MatrixView<Scalar> q =
      MlpForward<Scalar>(critic_layout_, critic_target_, input, critic_workspace_);
  ColumnMinima<Scalar>(q, target_q_);
}

template <typename Scalar>
void IqlCore<Scalar>::UpdateValue(const TransitionBatch<Scalar>& batch, IqlMetrics& metrics) {
  const int n = batch.size();
  const MatrixView<Scalar> v =
      MlpForward<Scalar>(value_layout_, value_, batch.observations, value_workspace_);
  metrics.value_loss =
      ExpectileLoss<Scalar>(OutputRow(v, 0, n), target_q_, static_cast<Scalar>(options_.expectile),
                            OutputRow(value_workspace_.output_gradient(), 0, n));
  MlpBackward<Scalar>(value_layout_, value_, batch.observations, value_workspace_, value_gradient_);
  value_adam_.Step(value_, value_gradient_);
  // What steps 2 and 3 read of the new V, in one pass.
  const MatrixView<Scalar> input = value_input_.view(2 * n);
  CopyMatrix<Scalar>(batch.observations, input.ColumnBlock(0, n));
  CopyMatrix<Scalar>(batch.next_observations, input.ColumnBlock(n, n));
  MlpForward<Scalar>(value_layout_, value_, input, value_workspace_);
}

template <typename Scalar>
void IqlCore<Scalar>::UpdateActor(const TransitionBatch<Scalar>& batch, IqlMetrics& metrics) {
  const int n = batch.size();
  const std::span<const Scalar> v = OutputRow(value_workspace_.output(), 0, n);
  metrics.mean_value = Mean<Scalar>(v);
  metrics.mean_weight =
      AdvantageWeights<Scalar>(target_q_, v, static_cast<Scalar>(options_.temperature),
                               static_cast<Scalar>(options_.weight_max), weights_);

  const MatrixView<Scalar> pi = actions_.view(n), pi_gradient = action_gradient_.view(n);
  const MatrixView<Scalar> head =
      MlpForward<Scalar>(actor_layout_, actor_, batch.observations, actor_workspace_);
  TanhForward<Scalar>(head, pi);
  metrics.actor_loss =
      options_.actor == IqlActor::kDeterministic
          ? WeightedSquaredError<Scalar>(pi, batch.actions, weights_, pi_gradient)
          : WeightedGaussianLoss<Scalar>(pi, log_std_, options_.log_std, batch.actions, weights_,
                                         pi_gradient, log_std_gradient_);
  TanhBackward<Scalar>(pi, pi_gradient, actor_workspace_.output_gradient());
  MlpBackward<Scalar>(actor_layout_, actor_, batch.observations, actor_workspace_, actor_gradient_);
  actor_adam_.set_learning_rate(actor_learning_rate());
  actor_adam_.Step(actor_, actor_gradient_);
  log_std_adam_.set_learning_rate(actor_learning_rate());
  log_std_adam_.Step(log_std_, log_std_gradient_);
}

template <typename Scalar>
void IqlCore<Scalar>::UpdateCritics(const TransitionBatch<Scalar>& batch, IqlMetrics& metrics) {
  const int n = batch.size();
  const MatrixView<const Scalar> next_v = value_workspace_.output().ColumnBlock(n, n);
  BellmanTargets<Scalar>(next_v, batch.rewards, batch.not_terminated,
                         static_cast<Scalar>(options_.gamma), {}, Scalar(0), targets_);
  metrics.mean_target = Mean<Scalar>(std::span<const Scalar>(targets_).first(n));

  const MatrixView<const Scalar> input = critic_input_.view(n);  // still (s, a)
  const MatrixView<Scalar> q =
      MlpForward<Scalar>(critic_layout_, critic_, input, critic_workspace_);
  const CriticLoss loss =
      SquaredErrorToTargets<Scalar>(q, targets_, Scalar(1), critic_workspace_.output_gradient());
  metrics.critic_loss = loss.loss;
  metrics.mean_q = loss.mean_q;
  MlpBackward<Scalar>(critic_layout_, critic_, input, critic_workspace_, critic_gradient_);
  // Step 4 rides along: nothing reads the target critics before the next update.
  critic_adam_.StepWithPolyak(critic_, critic_gradient_, options_.tau, critic_target_);
}

template <typename Scalar>
PolicyWeights IqlCore<Scalar>::Policy() const {
  return ActorWeights<Scalar>(actor_layout_, actor_, options_.action_size);
}

template <typename Scalar>
void IqlCore<Scalar>::VisitArrays(const ArrayVisitor<Scalar>& visitor) {
  value_layout_.Visit<Scalar>("value", value_, visitor);
  actor_layout_.Visit<Scalar>("actor", actor_, visitor);
  critic_layout_.Visit<Scalar>("critic", critic_, visitor);
  critic_layout_.Visit<Scalar>("critic_target", critic_target_, visitor);
  value_adam_.Visit("value/adam", visitor);
  actor_adam_.Visit("actor/adam", visitor);
  critic_adam_.Visit("critic/adam", visitor);
  if (log_std_.empty()) return;
  visitor({"log_std", {options_.action_size}, log_std_});
  log_std_adam_.Visit("log_std/adam", visitor);
}

template <typename Scalar>
void IqlCore<Scalar>::VisitCounters(const CounterVisitor& visitor) {
  visitor({"updates", &updates_});
  value_adam_.VisitCounters("value/adam", visitor);
  actor_adam_.VisitCounters("actor/adam", visitor);
  log_std_adam_.VisitCounters("log_std/adam", visitor);
  critic_adam_.VisitCounters("critic/adam", visitor);
}

template <typename Scalar>
void IqlCore<Scalar>::VisitGradients(const ArrayVisitor<Scalar>& visitor) {
  value_layout_.Visit<Scalar>("value", value_gradient_, visitor);
  actor_layout_.Visit<Scalar>("actor", actor_gradient_, visitor);
  critic_layout_.Visit<Scalar>("critic", critic_gradient_, visitor);
  if (!log_std_.empty()) visitor({"log_std", {options_.action_size}, log_std_gradient_});
}

template class IqlCore<float>;
template class IqlCore<double>;

}  // namespace b4mrl
