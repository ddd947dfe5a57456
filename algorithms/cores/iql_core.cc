#include "algorithms/cores/iql_core.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "algorithms/base/metrics.h"
#include "algorithms/nn/losses.h"
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

NetworkOptions ActorNetwork(const IqlOptions& options) {
  return {.shape = ActorShape(options, options.action_size),
          .learning_rate = options.actor_learning_rate,
          .batch_max = options.batch_max,
          .precision = options.precision,
          .weights = {Rng(options.seed, "iql-actor-weights"), options.initialization}};
}

NetworkOptions ValueNetwork(const IqlOptions& options) {
  return {.shape = ActorShape(options, 1),
          .learning_rate = options.value_learning_rate,
          .batch_max = 2 * options.batch_max,
          .precision = options.precision,
          .weights = {Rng(options.seed, "iql-value-weights"), options.initialization}};
}

// `n` numbers, from column `first` on, of the output of a network with one output.
template <typename Scalar>
std::span<Scalar> OutputRow(MatrixView<Scalar> row, int first, int n) {
  return {row.data + first, static_cast<size_t>(n)};
}

}  // namespace

void AddMetrics(const IqlMetrics& values, MetricMeans& metrics) {
  metrics.Add("value_loss", values.value_loss);
  metrics.Add("critic_loss", values.critic_loss);
  metrics.Add("actor_loss", values.actor_loss);
  metrics.Add("mean_value", values.mean_value);
  metrics.Add("mean_weight", values.mean_weight);
  metrics.Add("mean_q", values.mean_q);
  metrics.Add("mean_target", values.mean_target);
}

template <typename Scalar>
Result<IqlCore<Scalar>> IqlCore<Scalar>::Create(const IqlOptions& options) {
  B4MRL_RETURN_IF_ERROR(Validate(options));
  return IqlCore(options);
}

template <typename Scalar>
IqlCore<Scalar>::IqlCore(const IqlOptions& options)
    : options_(options),
      value_(ValueNetwork(options)),
      actor_(ActorNetwork(options)),
      log_std_(options.actor == IqlActor::kGaussian ? options.action_size : 0,
               options.actor_learning_rate),
      critics_(options, {Rng(options.seed, "iql-critic-weights"), options.initialization}),
      value_input_(options.observation_size, 2 * options.batch_max),
      actions_(options.action_size, options.batch_max),
      action_gradient_(options.action_size, options.batch_max),
      target_q_(options.batch_max),
      weights_(options.batch_max) {}

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
  ColumnMinima<Scalar>(critics_.EvaluateTargets(batch.observations, batch.actions), target_q_);
}

template <typename Scalar>
void IqlCore<Scalar>::UpdateValue(const TransitionBatch<Scalar>& batch, IqlMetrics& metrics) {
  const int n = batch.size();
  const MatrixView<Scalar> v = value_.Forward(batch.observations);
  metrics.value_loss =
      ExpectileLoss<Scalar>(OutputRow(v, 0, n), target_q_, static_cast<Scalar>(options_.expectile),
                            OutputRow(value_.workspace.output_gradient(), 0, n));
  value_.Backward(batch.observations);
  value_.Step();
  // One pass of the updated V computes V(s) for step 2 and V(s') for step 3.
  const MatrixView<Scalar> input = value_input_.view(2 * n);
  CopyMatrix<Scalar>(batch.observations, input.ColumnBlock(0, n));
  CopyMatrix<Scalar>(batch.next_observations, input.ColumnBlock(n, n));
  value_.Forward(input);
}

template <typename Scalar>
void IqlCore<Scalar>::UpdateActor(const TransitionBatch<Scalar>& batch, IqlMetrics& metrics) {
  const int n = batch.size();
  const std::span<const Scalar> v = OutputRow(value_.workspace.output(), 0, n);
  metrics.mean_value = Mean<Scalar>(v);
  metrics.mean_weight =
      AdvantageWeights<Scalar>(target_q_, v, static_cast<Scalar>(options_.temperature),
                               static_cast<Scalar>(options_.weight_max), weights_);

  const MatrixView<Scalar> pi = actions_.view(n), pi_gradient = action_gradient_.view(n);
  TanhForward<Scalar>(actor_.Forward(batch.observations), pi);
  metrics.actor_loss =
      options_.actor == IqlActor::kDeterministic
          ? WeightedSquaredError<Scalar>(pi, batch.actions, weights_, pi_gradient)
          : WeightedGaussianLoss<Scalar>(pi, log_std_.values, options_.log_std, batch.actions,
                                         weights_, pi_gradient, log_std_.gradient);
  TanhBackward<Scalar>(pi, pi_gradient, actor_.workspace.output_gradient());
  actor_.Backward(batch.observations);
  actor_.adam.set_learning_rate(actor_learning_rate());
  actor_.Step();
  log_std_.adam.set_learning_rate(actor_learning_rate());
  log_std_.Step();
}

template <typename Scalar>
void IqlCore<Scalar>::UpdateCritics(const TransitionBatch<Scalar>& batch, IqlMetrics& metrics) {
  const int n = batch.size();
  const MatrixView<const Scalar> next_v = value_.workspace.output().ColumnBlock(n, n);
  metrics.mean_target =
      BellmanTargets<Scalar>(next_v, batch.rewards, batch.not_terminated,
                             static_cast<Scalar>(options_.gamma), {}, Scalar(0), critics_.targets);
  const MatrixView<Scalar> q = critics_.Forward(critics_.input.view(n));  // still (s, a)
  const CriticLoss loss = SquaredErrorToTargets<Scalar>(q, critics_.targets, Scalar(1),
                                                        critics_.workspace.output_gradient());
  metrics.critic_loss = loss.loss;
  metrics.mean_q = loss.mean_q;
  // Train also does step 4, in one pass: nothing reads the target critics before the next update.
  critics_.Train(n, options_.tau);
}

template <typename Scalar>
PolicyWeights IqlCore<Scalar>::Policy() const {
  return ActorWeights<Scalar>(actor_, options_.action_size);
}

template class IqlCore<float>;
template class IqlCore<double>;

}  // namespace b4mrl
