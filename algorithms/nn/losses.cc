#include "algorithms/nn/losses.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace b4mrl {

template <typename Scalar>
double BellmanTargets(MatrixView<const Scalar> q, std::span<const Scalar> rewards,
                      std::span<const Scalar> not_terminated, Scalar gamma,
                      std::span<const Scalar> log_probs, Scalar entropy_scale,
                      std::span<Scalar> targets) {
  for (int i = 0; i < q.columns; ++i) {
    const Scalar* values = q.column(i);
    Scalar value = *std::min_element(values, values + q.rows);
    if (!log_probs.empty()) value -= entropy_scale * log_probs[i];
    targets[i] = rewards[i] + not_terminated[i] * gamma * value;
  }
  return Mean<Scalar>(targets.first(q.columns));
}

template <typename Scalar>
CriticLoss SquaredErrorToTargets(MatrixView<const Scalar> q, std::span<const Scalar> targets,
                                 Scalar scale, MatrixView<Scalar> q_gradient) {
  CriticLoss result;
  const Scalar slope = 2 * scale / static_cast<Scalar>(q.columns);
  for (int i = 0; i < q.columns; ++i) {
    for (int critic = 0; critic < q.rows; ++critic) {
      const Scalar error = q(critic, i) - targets[i];
      q_gradient(critic, i) = slope * error;
      result.loss += static_cast<double>(error) * error;
      result.mean_q += q(critic, i);
    }
  }
  result.loss *= scale / q.columns;
  result.mean_q /= static_cast<double>(q.rows) * q.columns;
  return result;
}

template <typename Scalar>
double MeanMinimum(MatrixView<const Scalar> q, MatrixView<Scalar> q_gradient) {
  double sum = 0;
  const Scalar slope = Scalar(-1) / static_cast<Scalar>(q.columns);
  for (int i = 0; i < q.columns; ++i) {
    const Scalar* values = q.column(i);
    const auto smallest = std::min_element(values, values + q.rows) - values;
    for (int critic = 0; critic < q.rows; ++critic) {
      q_gradient(critic, i) = critic == smallest ? slope : Scalar(0);
    }
    sum += values[smallest];
  }
  return sum / q.columns;
}

template <typename Scalar>
double AddMeanSquaredError(MatrixView<const Scalar> prediction, MatrixView<const Scalar> target,
                           MatrixView<Scalar> gradient) {
  const double size = static_cast<double>(prediction.rows) * prediction.columns;
  const Scalar slope = static_cast<Scalar>(2 / size);
  double sum = 0;
  for (int i = 0; i < prediction.columns; ++i) {
    for (int k = 0; k < prediction.rows; ++k) {
      const Scalar error = prediction(k, i) - target(k, i);
      gradient(k, i) += slope * error;
      sum += static_cast<double>(error) * error;
    }
  }
  return sum / size;
}

template <typename Scalar>
double MeanMagnitude(std::span<const Scalar> values) {
  double sum = 0;
  for (const Scalar value : values) sum += std::abs(value);
  return values.empty() ? std::numeric_limits<double>::quiet_NaN()
                        : sum / static_cast<double>(values.size());
}

template <typename Scalar>
double Mean(std::span<const Scalar> values) {
  double sum = 0;
  for (const Scalar value : values) sum += value;
  return values.empty() ? std::numeric_limits<double>::quiet_NaN()
                        : sum / static_cast<double>(values.size());
}

#define B4MRL_INSTANTIATE(Scalar)                                                                  \
  template double BellmanTargets<Scalar>(MatrixView<const Scalar>, std::span<const Scalar>,        \
                                         std::span<const Scalar>, Scalar, std::span<const Scalar>, \
                                         Scalar, std::span<Scalar>);                               \
  template CriticLoss SquaredErrorToTargets<Scalar>(                                               \
      MatrixView<const Scalar>, std::span<const Scalar>, Scalar, MatrixView<Scalar>);              \
  template double MeanMinimum<Scalar>(MatrixView<const Scalar>, MatrixView<Scalar>);               \
  template double AddMeanSquaredError<Scalar>(MatrixView<const Scalar>, MatrixView<const Scalar>,  \
                                              MatrixView<Scalar>);                                 \
  template double MeanMagnitude<Scalar>(std::span<const Scalar>);                                  \
  template double Mean<Scalar>(std::span<const Scalar>);
B4MRL_INSTANTIATE(float)
B4MRL_INSTANTIATE(double)
#undef B4MRL_INSTANTIATE

}  // namespace b4mrl
