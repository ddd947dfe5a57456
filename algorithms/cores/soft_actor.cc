#include "algorithms/cores/soft_actor.h"

#include <cmath>

#include "algorithms/base/metrics.h"
#include "algorithms/nn/losses.h"
#include "algorithms/nn/products/eigen_map.h"

namespace b4mrl {

Status ValidateSac(const SacOptions& options) {
  B4MRL_RETURN_IF_ERROR(ValidateActorCritic(options));
  B4MRL_RETURN_IF_ERROR(ValidateRate("alpha_learning_rate", options.alpha_learning_rate));
  if (!(options.initial_alpha > 0) || !std::isfinite(options.initial_alpha)) {
    return InvalidNumber("initial_alpha", options.initial_alpha, "a finite number above 0");
  }
  return {};
}

void AddMetrics(const SacMetrics& values, MetricMeans& metrics) {
  metrics.Add("critic_loss", values.critic_loss);
  metrics.Add("actor_loss", values.actor_loss);
  metrics.Add("alpha_loss", values.alpha_loss);
  metrics.Add("alpha", values.alpha);
  metrics.Add("mean_q", values.mean_q);
  metrics.Add("mean_target", values.mean_target);
  metrics.Add("entropy", values.entropy);
}

template <typename Scalar>
SoftActor<Scalar>::SoftActor(const SacOptions& options, const SoftActorVariant& variant)
    : options_(options),
      variant_(variant),
      network_({.shape = ActorShape(options, 2 * options.action_size),
                .learning_rate = options.actor_learning_rate,
                .batch_max = 2 * options.batch_max,
                .precision = options.precision,
                .scalars = variant.learns_log_std_scale ? 2 : 0,
                .scalars_name = "log_std_scale",
                .weights = {.stream = Rng(options.seed, "sac-actor-weights"),
                            .head_gain = variant.head_gain}}),
      log_alpha_(1, options.alpha_learning_rate),
      input_(options.observation_size, 2 * options.batch_max),
      scaled_head_(2 * options.action_size,
                   variant.learns_log_std_scale ? 2 * options.batch_max : 0),
      noise_(options.action_size, 2 * options.batch_max),
      actions_(options.action_size, 2 * options.batch_max),
      log_probs_(2 * static_cast<size_t>(options.batch_max)),
      action_gradient_(options.action_size, options.batch_max) {
  log_alpha_.values[0] = static_cast<Scalar>(std::log(options.initial_alpha));
  if (!variant_.learns_log_std_scale) return;
  network_.scalars()[0] = 1;
  network_.scalars()[1] = -1;
}

template <typename Scalar>
MatrixView<const Scalar> SoftActor<Scalar>::DrawNoise(int n, int64_t update) {
  const MatrixView<Scalar> noise = noise_.view(2 * n);
  Rng rng(options_.seed, "sac-noise", static_cast<uint64_t>(update));
  rng.FillNormal(noise.values());
  return noise;
}

template <typename Scalar>
MatrixView<const Scalar> SoftActor<Scalar>::Head(int columns) {
  if (variant_.learns_log_std_scale) return scaled_head_.view(columns);
  return network_.workspace.output().ColumnBlock(0, columns);
}

template <typename Scalar>
void SoftActor<Scalar>::Sample(const TransitionBatch<Scalar>& batch, MatrixView<const Scalar> noise,
                               SacMetrics& metrics) {
  const int n = batch.size();
  const MatrixView<Scalar> input = input_.view(2 * n);
  CopyMatrix<Scalar>(batch.observations, input.ColumnBlock(0, n));
  CopyMatrix<Scalar>(batch.next_observations, input.ColumnBlock(n, n));
  const MatrixView<Scalar> head = network_.Forward(input);
  if (variant_.learns_log_std_scale) {
    ScaleLogStd<Scalar>(head, network_.scalars(), scaled_head_.view(2 * n));
  }
  SampleSquashedGaussian<Scalar>(options_.policy, Head(2 * n), noise, actions_.view(2 * n),
                                 log_probs_);
  metrics.entropy = -Mean<Scalar>(std::span<const Scalar>(log_probs_).first(n));
}

template <typename Scalar>
void SoftActor<Scalar>::UpdateAlpha(SacMetrics& metrics) {
  const Scalar log_alpha = log_alpha_.values[0];
  alpha_ = std::exp(log_alpha);
  metrics.alpha = alpha_;
  const double target_entropy =
      options_.target_entropy.value_or(-static_cast<double>(options_.action_size));
  const double gradient = metrics.entropy - target_entropy;
  metrics.alpha_loss = gradient * log_alpha;
  log_alpha_.gradient[0] = static_cast<Scalar>(gradient);
  log_alpha_.Step();
}

template <typename Scalar>
void SoftActor<Scalar>::Update(const TransitionBatch<Scalar>& batch, MatrixView<const Scalar> noise,
                               TwinCritics<Scalar>& critics, SacMetrics& metrics) {
  const int n = batch.size();
  const MatrixView<const Scalar> actions = actions_.view(n);
  const MatrixView<Scalar> action_gradient = action_gradient_.view(n);
  const MatrixView<Scalar> q = critics.Evaluate(batch.observations, actions);
  const double mean_minimum = MeanMinimum<Scalar>(q, critics.workspace.output_gradient());
  metrics.actor_loss = -alpha_ * metrics.entropy - mean_minimum;
  critics.BackwardToInput(options_.observation_size, action_gradient);

  network_.workspace.batch = n;  // only the n columns of s, of 2 n columns, have a gradient
  const MatrixView<Scalar> head_gradient = network_.workspace.output_gradient();
  SquashedGaussianBackward<Scalar>(options_.policy, Head(n), noise.ColumnBlock(0, n), actions,
                                   action_gradient, alpha_ / static_cast<Scalar>(n), head_gradient);
  if (variant_.learns_log_std_scale) {
    ScaleLogStdBackward<Scalar>(network_.workspace.output(), network_.scalars(), head_gradient,
                                network_.scalar_gradient());
  }
  network_.Backward(input_.view(n));
  network_.Step();
}

template <typename Scalar>
PolicyWeights SoftActor<Scalar>::Policy() const {
  PolicyWeights weights = ActorWeights<Scalar>(network_, options_.action_size);
  if (variant_.learns_log_std_scale) {
    // m and b are multiplied into the log_std head, so that an agent file need not hold them.
    const std::span<const Scalar> scale = network_.scalars();
    const float m = static_cast<float>(scale[0]), b = static_cast<float>(scale[1]);
    for (float& weight : weights.log_std->weight) weight *= m;
    for (float& bias : weights.log_std->bias) bias = m * bias + b;
  }
  weights.log_std_min = static_cast<float>(options_.policy.log_std_min);
  weights.log_std_max = static_cast<float>(options_.policy.log_std_max);
  return weights;
}

template class SoftActor<float>;
template class SoftActor<double>;

}  // namespace b4mrl
