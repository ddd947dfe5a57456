#include "algorithms/cores/h2o_core.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "algorithms/base/metrics.h"
#include "algorithms/cores/h2o_losses.h"
#include "algorithms/nn/products/eigen_map.h"
#include "proto/base/rng.h"

namespace b4mrl {
namespace {

Status Validate(const H2oOptions& options) {
  if (options.gap_samples < 1 || options.gap_samples > 1024) {
    return InvalidArgument("gap_samples", std::to_string(options.gap_samples), "1..1024");
  }
  const int most = MaxGapSamples(options.observation_size, options.batch_max);
  if (options.gap_samples > most) {
    return InvalidNumber("gap_samples", options.gap_samples,
                         "at most " + std::to_string(most) + " for such a batch");
  }
  if (std::ssize(options.gap_noise) != options.observation_size) {
    return InvalidArgument("gap_noise", std::to_string(options.gap_noise.size()) + " numbers",
                           std::to_string(options.observation_size) + ", one a dimension");
  }
  for (const double deviation : options.gap_noise) {
    B4MRL_RETURN_IF_ERROR(ValidateRate("gap_noise", deviation));
  }
  if (!(options.ratio_min > 0 && options.ratio_min <= 1)) {
    return InvalidNumber("ratio_min", options.ratio_min, "above 0, at most 1");
  }
  if (!(options.gap_max > 1e-45)) return InvalidNumber("gap_max", options.gap_max, "above 1e-45");
  B4MRL_RETURN_IF_ERROR(ValidateRate("gap_weight", options.gap_weight));
  return ValidateRate("gap_limit", options.gap_limit);
}

DiscriminatorOptions DiscriminatorsOf(const H2oOptions& options) {
  return {.observation_size = options.observation_size,
          .action_size = options.action_size,
          .hidden = options.hidden,
          .batch_max = std::max(options.discriminator_batch_max, options.batch_max),
          .learning_rate = options.discriminator_learning_rate,
          .input_noise = options.discriminator_noise,
          .seed = options.seed,
          .precision = options.precision};
}

}  // namespace

std::vector<double> GapNoise(std::span<const double> mean, std::span<const double> std,
                             GapNoiseStd over, double scale) {
  constexpr double kRowsPerData = 11;  // rows of the padded array per row of the dataset
  constexpr double kStdEpsilon = 1e-3;
  std::vector<double> noise;
  for (size_t i = 0; i < std.size(); ++i) {
    double variance = std[i] * std[i];
    if (over == GapNoiseStd::kPadded) {
      const double padded_mean = mean[i] / kRowsPerData;
      variance = (variance + mean[i] * mean[i]) / kRowsPerData - padded_mean * padded_mean;
    }
    noise.push_back(scale * (std::sqrt(variance) + kStdEpsilon));
  }
  return noise;
}

int MaxGapSamples(int observation_size, int batch_max) {
  constexpr int64_t kCopiedNumbersMax = 1 << 27;  // 512 MiB of floats
  const int64_t batch_numbers = int64_t{observation_size} * batch_max;
  return static_cast<int>(std::clamp<int64_t>(kCopiedNumbersMax / batch_numbers - 1, 0, 1024));
}

void AddMetrics(const H2oMetrics& values, MetricMeans& metrics) {
  AddMetrics(values.sac, metrics);
  metrics.Add("critic_loss_real", values.critic.real_loss);
  metrics.Add("critic_loss_simulated", values.critic.simulated_loss);
  metrics.Add("mean_q_real", values.critic.mean_real_q);
  metrics.Add("mean_q_simulated", values.critic.mean_simulated_q);
  metrics.Add("gap_penalty", values.gap_penalty);
  metrics.Add("mean_gap", values.mean_gap);
  metrics.Add("mean_weight", values.mean_weight);
  metrics.Add("d_sa_loss", values.discriminators.state_action_loss);
  metrics.Add("d_sas_loss", values.discriminators.transition_loss);
}

template <typename Scalar>
Result<H2oCore<Scalar>> H2oCore<Scalar>::Create(const H2oOptions& options) {
  B4MRL_RETURN_IF_ERROR(ValidateSac(options));
  B4MRL_RETURN_IF_ERROR(Validate(options));
  B4MRL_ASSIGN_OR_RETURN(Discriminators<Scalar> discriminators,
                         Discriminators<Scalar>::Create(DiscriminatorsOf(options)));
  return H2oCore(options, std::move(discriminators));
}

template <typename Scalar>
H2oCore<Scalar>::H2oCore(const H2oOptions& options, Discriminators<Scalar> discriminators)
    : options_(options),
      actor_(options, {.learns_log_std_scale = true, .head_gain = options.head_gain}),
      critics_(options,
               {.stream = Rng(options.seed, "sac-critic-weights"), .head_gain = options.head_gain}),
      discriminators_(std::move(discriminators)),
      next_copies_(options.observation_size, options.batch_max * (1 + options.gap_samples)),
      log_ratios_(options.batch_max * (1 + options.gap_samples)),
      weights_(options.batch_max),
      gaps_(options.batch_max),
      log_gap_weights_(options.batch_max) {}

template <typename Scalar>
H2oMetrics H2oCore<Scalar>::Update(const HybridBatch<Scalar>& batch,
                                   const HybridBatch<Scalar>& discriminator_batch,
                                   const H2oNoise<Scalar>& noise) {
  const MatrixView<const Scalar> action_noise =
      noise.actions.columns > 0 ? noise.actions : actor_.DrawNoise(batch.rows.size(), updates_);
  H2oMetrics metrics;
  metrics.discriminators = discriminators_.Update(discriminator_batch, noise.discriminators);
  WeighSimulated(batch.simulated(), noise.gap, metrics);
  actor_.Sample(batch.rows, action_noise, metrics.sac);
  actor_.UpdateAlpha(metrics.sac);
  ComputeTargets(batch.rows, metrics);
  actor_.Update(batch.rows, action_noise, critics_, metrics.sac);
  UpdateCritics(batch, metrics);
  ++updates_;
  return metrics;
}

template <typename Scalar>
MatrixView<const Scalar> H2oCore<Scalar>::DrawGapNoise(int simulated_rows) {
  const int copies = simulated_rows * options_.gap_samples;
  const MatrixView<Scalar> noise =
      next_copies_.view(simulated_rows + copies).ColumnBlock(simulated_rows, copies);
  Rng rng(options_.seed, "gap-noise", static_cast<uint64_t>(updates_));
  rng.FillNormal(noise.values());
  return noise;
}

template <typename Scalar>
void H2oCore<Scalar>::WeighSimulated(const TransitionBatch<Scalar>& simulated,
                                     MatrixView<const Scalar> noise, H2oMetrics& metrics) {
  const int n = simulated.size();
  if (noise.columns == 0) noise = DrawGapNoise(n);
  const MatrixView<Scalar> next = next_copies_.view(n * (1 + options_.gap_samples));
  CopyMatrix<Scalar>(simulated.next_observations, next.ColumnBlock(0, n));
  for (int i = n; i < next.columns; ++i) {
    for (int k = 0; k < next.rows; ++k) {
      next(k, i) = next(k, i % n) + static_cast<Scalar>(options_.gap_noise[k]) * noise(k, i - n);
    }
  }
  const std::span<Scalar> log_ratios = std::span<Scalar>(log_ratios_).first(next.columns);
  discriminators_.LogDynamicsRatios(simulated, next, log_ratios);
  metrics.mean_weight = DynamicsWeights<Scalar>(log_ratios.first(n), options_.ratio_min,
                                                std::span<Scalar>(weights_).first(n));

  const std::span<Scalar> gaps = std::span<Scalar>(gaps_).first(n);
  std::fill(gaps.begin(), gaps.end(), Scalar(0));
  for (int i = n; i < next.columns; ++i) gaps[i % n] -= log_ratios[i];
  for (Scalar& gap : gaps) gap /= static_cast<Scalar>(options_.gap_samples);
  metrics.mean_gap =
      LogGapWeights<Scalar>(gaps, options_.gap_max, std::span<double>(log_gap_weights_).first(n));
}

template <typename Scalar>
void H2oCore<Scalar>::ComputeTargets(const TransitionBatch<Scalar>& batch, H2oMetrics& metrics) {
  const MatrixView<Scalar> q =
      critics_.EvaluateTargets(batch.next_observations, actor_.next_actions(batch.size()));
  metrics.sac.mean_target =
      BellmanTargets<Scalar>(q, batch.rewards, batch.not_terminated,
                             static_cast<Scalar>(options_.gamma), {}, Scalar(0), critics_.targets);
}

template <typename Scalar>
void H2oCore<Scalar>::UpdateCritics(const HybridBatch<Scalar>& batch, H2oMetrics& metrics) {
  const int simulated = batch.simulated_rows();
  const auto weights = std::span<const Scalar>(weights_).first(simulated);
  const auto log_gap_weights = std::span<const double>(log_gap_weights_).first(simulated);
  const MatrixView<Scalar> q = critics_.Evaluate(batch.rows.observations, batch.rows.actions);
  const MatrixView<Scalar> q_gradient = critics_.workspace.output_gradient();
  metrics.critic = HybridSquaredError<Scalar>(q, critics_.targets, weights, q_gradient);
  metrics.gap_penalty = AddGapPenalty<Scalar>(q, log_gap_weights, options_.gap_weight,
                                              options_.gap_limit, q_gradient);
  metrics.sac.critic_loss = metrics.critic.loss;
  metrics.sac.mean_q = metrics.critic.mean_q;
  critics_.Train(batch.rows.size(), options_.tau);
}

template class H2oCore<float>;
template class H2oCore<double>;

}  // namespace b4mrl
