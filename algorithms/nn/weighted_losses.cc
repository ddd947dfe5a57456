#include "algorithms/nn/weighted_losses.h"

#include <algorithm>
#include <cmath>

namespace b4mrl {

template <typename Scalar>
void ColumnMinima(MatrixView<const Scalar> matrix, std::span<Scalar> minima) {
  for (int i = 0; i < matrix.columns; ++i) {
    const Scalar* values = matrix.column(i);
    minima[i] = *std::min_element(values, values + matrix.rows);
  }
}

template <typename Scalar>
double ExpectileLoss(std::span<const Scalar> predictions, std::span<const Scalar> targets,
                     Scalar expectile, std::span<Scalar> gradient) {
  const size_t n = predictions.size();
  const Scalar slope = Scalar(-2) / static_cast<Scalar>(n);
  double sum = 0;
  for (size_t i = 0; i < n; ++i) {
    const Scalar error = targets[i] - predictions[i];
    const Scalar weight = error > 0 ? expectile : 1 - expectile;
    gradient[i] = slope * weight * error;
    sum += static_cast<double>(weight) * error * error;
  }
  return sum / static_cast<double>(n);
}

template <typename Scalar>
double AdvantageWeights(std::span<const Scalar> q, std::span<const Scalar> v, Scalar temperature,
                        Scalar largest, std::span<Scalar> weights) {
  const size_t n = v.size();
  double sum = 0;
  for (size_t i = 0; i < n; ++i) {
    // This order of std::min's arguments keeps NaN; an overflow to infinity becomes `largest`.
    weights[i] = std::min(std::exp(temperature * (q[i] - v[i])), largest);
    sum += weights[i];
  }
  return sum / static_cast<double>(n);
}

template <typename Scalar>
double WeightedSquaredError(MatrixView<const Scalar> prediction, MatrixView<const Scalar> target,
                            std::span<const Scalar> weights, MatrixView<Scalar> gradient) {
  const double size = static_cast<double>(prediction.rows) * prediction.columns;
  double sum = 0;
  for (int i = 0; i < prediction.columns; ++i) {
    const Scalar slope = static_cast<Scalar>(2 / size) * weights[i];
    double column = 0;
    for (int k = 0; k < prediction.rows; ++k) {
      const Scalar error = prediction(k, i) - target(k, i);
      gradient(k, i) = slope * error;
      column += static_cast<double>(error) * error;
    }
    sum += weights[i] * column;
  }
  return sum / size;
}

template <typename Scalar>
double WeightedGaussianLoss(MatrixView<const Scalar> mean, std::span<const Scalar> log_std,
                            const LogStdRange& range, MatrixView<const Scalar> target,
                            std::span<const Scalar> weights, MatrixView<Scalar> mean_gradient,
                            std::span<Scalar> log_std_gradient) {
  constexpr double kHalfLogTwoPi = 0.91893853320467274178;
  const Scalar low = static_cast<Scalar>(range.low), high = static_cast<Scalar>(range.high);
  const Scalar share = Scalar(1) / static_cast<Scalar>(mean.columns);
  double loss = 0;
  for (int k = 0; k < mean.rows; ++k) {
    const Scalar clamped = std::min(std::max(log_std[k], low), high);
    const Scalar precision_root = std::exp(-clamped);
    double row = 0, row_gradient = 0;
    for (int i = 0; i < mean.columns; ++i) {
      const Scalar z = (target(k, i) - mean(k, i)) * precision_root;
      const Scalar weight = weights[i] * share;
      mean_gradient(k, i) = -weight * z * precision_root;
      row += weight * (0.5 * z * z + clamped + kHalfLogTwoPi);
      row_gradient += static_cast<double>(weight) * (1 - z * z);
    }
    loss += row;
    log_std_gradient[k] = clamped == log_std[k] ? static_cast<Scalar>(row_gradient) : Scalar(0);
  }
  return loss;
}

#define B4MRL_INSTANTIATE(Scalar)                                                                  \
  template void ColumnMinima<Scalar>(MatrixView<const Scalar>, std::span<Scalar>);                 \
  template double ExpectileLoss<Scalar>(std::span<const Scalar>, std::span<const Scalar>, Scalar,  \
                                        std::span<Scalar>);                                        \
  template double AdvantageWeights<Scalar>(std::span<const Scalar>, std::span<const Scalar>,       \
                                           Scalar, Scalar, std::span<Scalar>);                     \
  template double WeightedSquaredError<Scalar>(MatrixView<const Scalar>, MatrixView<const Scalar>, \
                                               std::span<const Scalar>, MatrixView<Scalar>);       \
  template double WeightedGaussianLoss<Scalar>(                                                    \
      MatrixView<const Scalar>, std::span<const Scalar>, const LogStdRange&,                       \
      MatrixView<const Scalar>, std::span<const Scalar>, MatrixView<Scalar>, std::span<Scalar>);
B4MRL_INSTANTIATE(float)
B4MRL_INSTANTIATE(double)
#undef B4MRL_INSTANTIATE

}  // namespace b4mrl
