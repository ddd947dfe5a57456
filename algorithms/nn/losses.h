// Losses on the outputs of networks, each with its gradient. Sums run in index order; a mean is
// over the batch's columns. Thread rule: pure functions.
#pragma once

#include <span>

#include "algorithms/nn/products/view.h"

namespace b4mrl {

// Bellman targets y = r + not_terminated * gamma * (min over rows of q - entropy_scale * log_prob),
// per column. q: critics x n. `log_probs` empty: no entropy term. Writes y to the first n of
// `targets` and returns the mean of y.
template <typename Scalar>
double BellmanTargets(MatrixView<const Scalar> q, std::span<const Scalar> rewards,
                      std::span<const Scalar> not_terminated, Scalar gamma,
                      std::span<const Scalar> log_probs, Scalar entropy_scale,
                      std::span<Scalar> targets);

struct CriticLoss {
  double loss = 0;    // scale * sum over critics of mean (q - y)^2
  double mean_q = 0;  // over critics and columns
};
// The squared error of q (critics x n) to `targets`; also writes q_gradient = d loss / d q.
template <typename Scalar>
CriticLoss SquaredErrorToTargets(MatrixView<const Scalar> q, std::span<const Scalar> targets,
                                 Scalar scale, MatrixView<Scalar> q_gradient);

// Returns the mean over columns of the minimum over rows of q (critics x n). Writes q_gradient =
// d(-mean min) / d q: -1/n at each column's minimum (the first row on a tie), 0 elsewhere.
template <typename Scalar>
double MeanMinimum(MatrixView<const Scalar> q, MatrixView<Scalar> q_gradient);

// Returns the mean over all elements of (prediction - target)^2 and adds its gradient to
// `gradient`.
template <typename Scalar>
double AddMeanSquaredError(MatrixView<const Scalar> prediction, MatrixView<const Scalar> target,
                           MatrixView<Scalar> gradient);

// MeanMagnitude: mean of |values|. Mean: mean of values. Both are NaN if `values` is empty.
template <typename Scalar>
double MeanMagnitude(std::span<const Scalar> values);
template <typename Scalar>
double Mean(std::span<const Scalar> values);

}  // namespace b4mrl
