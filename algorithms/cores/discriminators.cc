#include "algorithms/cores/discriminators.h"

#include <algorithm>
#include <cmath>

#include "algorithms/cores/actor_critic.h"
#include "algorithms/nn/products/eigen_map.h"
#include "algorithms/nn/squashed_gaussian.h"
#include "proto/base/rng.h"

namespace b4mrl {
namespace {

constexpr int kClasses = 2;
constexpr double kLogitScale = 2;

Status Validate(const DiscriminatorOptions& options) {
  B4MRL_RETURN_IF_ERROR(ValidateSizes(options.observation_size, options.action_size, options.hidden,
                                      options.batch_max));
  B4MRL_RETURN_IF_ERROR(ValidateRate("discriminator learning_rate", options.learning_rate));
  return ValidateRate("input_noise", options.input_noise);
}

// -log softmax of the class whose logit is `margin` above the other's; slope = its derivative.
template <typename Scalar>
double CrossEntropy(Scalar margin, Scalar& slope) {
  slope = Scalar(-1) / (1 + std::exp(margin));
  return std::log1p(std::exp(-static_cast<double>(margin)));
}

// Column i's share in the mean cross entropy of real columns plus that of simulated ones; `margin`
// is the real class's.
template <typename Scalar>
double ColumnLoss(const HybridBatch<Scalar>& batch, int i, Scalar margin, Scalar& slope) {
  const bool real = i < batch.real_rows;
  const int rows = real ? batch.real_rows : batch.simulated_rows();
  const double loss = CrossEntropy<Scalar>(real ? margin : -margin, slope);
  slope *= Scalar(real ? 1 : -1) / static_cast<Scalar>(rows);
  return loss / rows;
}

}  // namespace

template <typename Scalar>
Result<Discriminators<Scalar>> Discriminators<Scalar>::Create(const DiscriminatorOptions& options) {
  B4MRL_RETURN_IF_ERROR(Validate(options));
  return Discriminators(options);
}

template <typename Scalar>
Discriminators<Scalar>::Network::Network(const DiscriminatorOptions& options, int inputs)
    : layout({.inputs = inputs, .hidden = options.hidden, .outputs = kClasses}),
      parameters(layout.size()),
      gradient(layout.size()),
      adam({.learning_rate = options.learning_rate}, layout.size()),
      workspace(layout, 1, options.batch_max),
      logits(kClasses, options.batch_max) {}

template <typename Scalar>
void Discriminators<Scalar>::Network::Forward(MatrixView<const Scalar> input) {
  const MatrixView<Scalar> output = MlpForward<Scalar>(layout, parameters, input, workspace);
  TanhForward<Scalar>(output, logits.view(input.columns));
  ToEigen(logits.view(input.columns)) *= static_cast<Scalar>(kLogitScale);
}

template <typename Scalar>
void Discriminators<Scalar>::Network::Step(MatrixView<const Scalar> input,
                                           std::span<const Scalar> slopes) {
  const MatrixView<Scalar> output_gradient = workspace.output_gradient();
  for (int i = 0; i < input.columns; ++i) {
    for (int k = 0; k < kClasses; ++k) {
      const Scalar tanh = logits.view()(k, i) / static_cast<Scalar>(kLogitScale);
      const Scalar slope = static_cast<Scalar>(kLogitScale) * (1 - tanh * tanh);
      output_gradient(k, i) = (k == 0 ? slope : -slope) * slopes[i];
    }
  }
  MlpBackward<Scalar>(layout, parameters, input, workspace, gradient);
  adam.Step(parameters, gradient);
}

template <typename Scalar>
Discriminators<Scalar>::Discriminators(const DiscriminatorOptions& options)
    : options_(options),
      state_action_(options, options.observation_size + options.action_size),
      transition_(options, 2 * options.observation_size + options.action_size),
      input_(2 * options.observation_size + options.action_size, options.batch_max),
      noise_(2 * options.observation_size + options.action_size, options.batch_max),
      state_action_slopes_(options.batch_max),
      transition_slopes_(options.batch_max) {
  Rng state_action_rng(options.seed, "d-sa-weights");
  Rng transition_rng(options.seed, "d-sas-weights");
  state_action_.layout.template Initialize<Scalar>(Initialization::kTorchUniform, state_action_rng,
                                                   state_action_.parameters);
  transition_.layout.template Initialize<Scalar>(Initialization::kTorchUniform, transition_rng,
                                                 transition_.parameters);
}

template <typename Scalar>
DiscriminatorMetrics Discriminators<Scalar>::Update(const HybridBatch<Scalar>& batch) {
  const MatrixView<Scalar> noise = noise_.view(batch.rows.size());
  Rng rng(options_.seed, "discriminator-noise", static_cast<uint64_t>(steps()));
  rng.FillNormal(noise.values());
  return Step(batch);
}

template <typename Scalar>
DiscriminatorMetrics Discriminators<Scalar>::UpdateWithNoise(const HybridBatch<Scalar>& batch,
                                                             MatrixView<const Scalar> noise) {
  CopyMatrix<Scalar>(noise, noise_.view(batch.rows.size()));
  return Step(batch);
}

template <typename Scalar>
DiscriminatorMetrics Discriminators<Scalar>::Step(const HybridBatch<Scalar>& batch) {
  const int n = batch.rows.size();
  const MatrixView<Scalar> input = input_.view(n);
  StackRows<Scalar>({batch.rows.observations, batch.rows.actions, batch.rows.next_observations},
                    input);
  ToEigen(input) += static_cast<Scalar>(options_.input_noise) * ToEigen(noise_.view(n));
  const MatrixView<const Scalar> state_action_input =
      input.RowBlock(0, options_.observation_size + options_.action_size);
  state_action_.Forward(state_action_input);
  transition_.Forward(input);

  DiscriminatorMetrics metrics;
  for (int i = 0; i < n; ++i) {
    const Scalar margin = state_action_.margin(i);
    metrics.state_action_loss += ColumnLoss(batch, i, margin, state_action_slopes_[i]);
    metrics.transition_loss +=
        ColumnLoss(batch, i, margin + transition_.margin(i), transition_slopes_[i]);
    state_action_slopes_[i] += transition_slopes_[i];  // D_sa is part of both losses
  }
  state_action_.Step(state_action_input, std::span<const Scalar>(state_action_slopes_).first(n));
  transition_.Step(input, std::span<const Scalar>(transition_slopes_).first(n));
  return metrics;
}

template <typename Scalar>
void Discriminators<Scalar>::LogDynamicsRatios(const TransitionBatch<Scalar>& batch,
                                               MatrixView<const Scalar> next_observations,
                                               std::span<Scalar> log_ratios) {
  const int n = batch.size();
  const int step = options_.batch_max / n * n;
  for (int first = 0; first < next_observations.columns; first += step) {
    const int count = std::min(step, next_observations.columns - first);
    const MatrixView<Scalar> input = input_.view(count);
    for (int start = 0; start < count; start += n) {
      StackRows<Scalar>(
          {batch.observations, batch.actions, next_observations.ColumnBlock(first + start, n)},
          input.ColumnBlock(start, n));
    }
    transition_.Forward(input);
    for (int i = 0; i < count; ++i) log_ratios[first + i] = transition_.margin(i);
  }
}

template <typename Scalar>
void Discriminators<Scalar>::VisitArrays(const ArrayVisitor<Scalar>& visitor) {
  state_action_.layout.template Visit<Scalar>("d_sa", state_action_.parameters, visitor);
  transition_.layout.template Visit<Scalar>("d_sas", transition_.parameters, visitor);
  state_action_.adam.Visit("d_sa/adam", visitor);
  transition_.adam.Visit("d_sas/adam", visitor);
}

template <typename Scalar>
void Discriminators<Scalar>::VisitCounters(const CounterVisitor& visitor) {
  state_action_.adam.VisitCounters("d_sa/adam", visitor);
  transition_.adam.VisitCounters("d_sas/adam", visitor);
}

template <typename Scalar>
void Discriminators<Scalar>::VisitGradients(const ArrayVisitor<Scalar>& visitor) {
  state_action_.layout.template Visit<Scalar>("d_sa", state_action_.gradient, visitor);
  transition_.layout.template Visit<Scalar>("d_sas", transition_.gradient, visitor);
}

template class Discriminators<float>;
template class Discriminators<double>;

}  // namespace b4mrl
