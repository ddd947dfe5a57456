// Regression with weights: the losses of implicit Q-learning (Kostrikov et al. 2021), each with its
// gradient. Sums run in index order; a NaN among predictions, targets or weights makes the loss
// NaN. Thread rule: pure functions.
#pragma once

#include <span>

#include "algorithms/nn/products/view.h"

namespace b4mrl {

// minima[i] = the smallest number of column i.
template <typename Scalar>
void ColumnMinima(MatrixView<const Scalar> matrix, std::span<Scalar> minima);

// Expectile regression: mean of |expectile - 1(target < prediction)| (target - prediction)^2. At an
// expectile of 0.5 it is half the squared error; towards 1 the best prediction approaches the
// largest target. Writes gradient = d loss / d prediction.
template <typename Scalar>
double ExpectileLoss(std::span<const Scalar> predictions, std::span<const Scalar> targets,
                     Scalar expectile, std::span<Scalar> gradient);

// weights = min(exp(temperature (q - v)), largest); returns their mean.
template <typename Scalar>
double AdvantageWeights(std::span<const Scalar> q, std::span<const Scalar> v, Scalar temperature,
                        Scalar largest, std::span<Scalar> weights);

// mean over all elements of weight (prediction - target)^2, one weight a column; writes gradient =
// d loss / d prediction.
template <typename Scalar>
double WeightedSquaredError(MatrixView<const Scalar> prediction, MatrixView<const Scalar> target,
                            std::span<const Scalar> weights, MatrixView<Scalar> gradient);

struct LogStdRange {
  double low = -5;
  double high = 2;
};

// -mean over columns of weight log N(target | mean, diag(exp(2 clamp(log_std)))), with one raw
// log_std a row, the same in all columns. Writes mean_gradient and log_std_gradient; the latter is
// 0 where log_std was clamped. At most kActionMax (nn/squashed_gaussian.h) rows.
template <typename Scalar>
double WeightedGaussianLoss(MatrixView<const Scalar> mean, std::span<const Scalar> log_std,
                            const LogStdRange& range, MatrixView<const Scalar> target,
                            std::span<const Scalar> weights, MatrixView<Scalar> mean_gradient,
                            std::span<Scalar> log_std_gradient);

}  // namespace b4mrl
