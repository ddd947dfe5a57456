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
  B4MRL_RETURN_IF_ERROR(CheckPrecision(options.precision));
  B4MRL_RETURN_IF_ERROR(ValidateRate("discriminator learning_rate", options.learning_rate));
  return ValidateRate("input_noise", options.input_noise);
}

// -log softmax of the class whose logit is `margin` above the other class's logit. Writes the
// derivative by `margin` to `slope`.
template <typename Scalar>
double CrossEntropy(Scalar margin, Scalar& slope) {
  slope = Scalar(-1) / (1 + std::exp(margin));
  return std::log1p(std::exp(-static_cast<double>(margin)));
}

// Column i's term of the loss, which is the mean cross entropy over real columns plus the mean over
// simulated columns. `margin`: the logit of class real minus the logit of class simulated.
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
Discriminators<Scalar>::Classifier::Classifier(const DiscriminatorOptions& options, int inputs,
                                               std::string_view weights)
    : Network<Scalar>({.shape = {.inputs = inputs, .hidden = options.hidden, .outputs = kClasses},
                       .learning_rate = options.learning_rate,
                       .batch_max = options.batch_max,
                       .precision = options.precision,
                       .weights = {Rng(options.seed, weights)}}),
      logits(kClasses, options.batch_max) {}

template <typename Scalar>
void Discriminators<Scalar>::Classifier::Classify(MatrixView<const Scalar> input) {
  TanhForward<Scalar>(this->Forward(input), logits.view(input.columns));
  ToEigen(logits.view(input.columns)) *= static_cast<Scalar>(kLogitScale);
}

template <typename Scalar>
void Discriminators<Scalar>::Classifier::Train(MatrixView<const Scalar> input,
                                               std::span<const Scalar> slopes) {
  const MatrixView<Scalar> output_gradient = this->workspace.output_gradient();
  for (int i = 0; i < input.columns; ++i) {
    for (int k = 0; k < kClasses; ++k) {
      const Scalar tanh = logits.view()(k, i) / static_cast<Scalar>(kLogitScale);
      const Scalar slope = static_cast<Scalar>(kLogitScale) * (1 - tanh * tanh);
      output_gradient(k, i) = (k == 0 ? slope : -slope) * slopes[i];
    }
  }
  this->Backward(input);
  this->Step();
}

template <typename Scalar>
Discriminators<Scalar>::Discriminators(const DiscriminatorOptions& options)
    : options_(options),
      state_action_(options, options.observation_size + options.action_size, "d-sa-weights"),
      transition_(options, 2 * options.observation_size + options.action_size, "d-sas-weights"),
      input_(2 * options.observation_size + options.action_size, options.batch_max),
      noise_(2 * options.observation_size + options.action_size, options.batch_max),
      state_action_slopes_(options.batch_max),
      transition_slopes_(options.batch_max) {}

template <typename Scalar>
MatrixView<const Scalar> Discriminators<Scalar>::DrawNoise(int n) {
  Rng rng(options_.seed, "discriminator-noise", static_cast<uint64_t>(steps()));
  rng.FillNormal(noise_.view(n).values());
  return noise_.view(n);
}

template <typename Scalar>
DiscriminatorMetrics Discriminators<Scalar>::Update(const HybridBatch<Scalar>& batch,
                                                    MatrixView<const Scalar> noise) {
  const int n = batch.rows.size();
  if (noise.columns == 0) noise = DrawNoise(n);
  const MatrixView<Scalar> input = input_.view(n);
  StackRows<Scalar>({batch.rows.observations, batch.rows.actions, batch.rows.next_observations},
                    input);
  ToEigen(input) += static_cast<Scalar>(options_.input_noise) * ToEigen(noise);
  const MatrixView<const Scalar> state_action_input =
      input.RowBlock(0, options_.observation_size + options_.action_size);
  state_action_.Classify(state_action_input);
  transition_.Classify(input);

  DiscriminatorMetrics metrics;
  for (int i = 0; i < n; ++i) {
    const Scalar margin = state_action_.margin(i);
    metrics.state_action_loss += ColumnLoss(batch, i, margin, state_action_slopes_[i]);
    metrics.transition_loss +=
        ColumnLoss(batch, i, margin + transition_.margin(i), transition_slopes_[i]);
    state_action_slopes_[i] += transition_slopes_[i];  // D_sa is part of both losses
  }
  state_action_.Train(state_action_input, state_action_slopes_);
  transition_.Train(input, transition_slopes_);
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
    transition_.Classify(input);
    for (int i = 0; i < count; ++i) log_ratios[first + i] = transition_.margin(i);
  }
}

template class Discriminators<float>;
template class Discriminators<double>;

}  // namespace b4mrl
