// Regression with weights: the losses of implicit Q-learning (Kostrikov et al. 2021), each with its
// gradient. Sums run in index order; a NaN among predictions, targets or weights makes the loss
// NaN. Thread rule: pure functions.
#pragma once

#include <span>

#include "algorithms/nn/products/view.h"

namespace b4mrl {

// Writes to minima[i] the smallest number in column i of `matrix`.
template <typename Scalar>
void ColumnMinima(MatrixView<const Scalar> matrix, std::span<Scalar> minima);

// Expectile regression: mean of |expectile - 1(target < prediction)| (target - prediction)^2. With
// expectile 0.5 the loss is half the mean squared error; as expectile goes to 1, the best
// prediction approaches the largest target. Writes gradient = d loss / d prediction.
template <typename Scalar>
double ExpectileLoss(std::span<const Scalar> predictions, std::span<const Scalar> targets,
                     Scalar expectile, std::span<Scalar> gradient);

// Advantage weights: weights = min(exp(temperature (q - v)), largest). Returns the mean weight.
template <typename Scalar>
double AdvantageWeights(std::span<const Scalar> q, std::span<const Scalar> v, Scalar temperature,
                        Scalar largest, std::span<Scalar> weights);

// Weighted squared error: mean over all elements of weight (prediction - target)^2, with one weight
// per column. Writes gradient = d loss / d prediction.
template <typename Scalar>
double WeightedSquaredError(MatrixView<const Scalar> prediction, MatrixView<const Scalar> target,
                            std::span<const Scalar> weights, MatrixView<Scalar> gradient);

struct LogStdRange {
  double low = -5;
  double high = 2;
};

// Weighted Gaussian loss: -mean over columns of weight log N(target | mean, diag(exp(2
// clamp(log_std)))), with one raw log_std per row, equal in all columns. Writes mean_gradient and
// log_std_gradient, which is 0 where log_std was clamped. At most kActionMax
// (nn/squashed_gaussian.h) rows.
template <typename Scalar>
double WeightedGaussianLoss(MatrixView<const Scalar> mean, std::span<const Scalar> log_std,
                            const LogStdRange& range, MatrixView<const Scalar> target,
                            std::span<const Scalar> weights, MatrixView<Scalar> mean_gradient,
                            std::span<Scalar> log_std_gradient);

}  // namespace b4mrl
