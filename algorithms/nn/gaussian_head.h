// The head of a network that predicts a Gaussian: bounded log-variances, the loss and samples.
//
// The network's output has 2 K rows: K means, then K raw log-variances, which trained soft bounds
// `bounds` = (max[K], min[K]) limit to lv (Chua et al., "PETS", 2018, appendix A):
//   a = max - softplus(max - raw);  lv = min + softplus(a - min)
//   loss = mean_{B,K}((mean - y)^2 exp(-lv)) + mean_{B,K}(lv), over a batch of B columns
// Thread rule: pure functions. K is at most kGaussianOutputsMax.
#pragma once

#include <span>

#include "algorithms/nn/products/view.h"

namespace b4mrl {

inline constexpr int kGaussianOutputsMax = 1024;

// output: 2 K x n; targets: K x n. Returns the loss, writes output_gradient (2 K x n) and adds to
// bounds_gradient (2 K).
template <typename Scalar>
double GaussianHeadLoss(MatrixView<const Scalar> output, MatrixView<const Scalar> targets,
                        std::span<const Scalar> bounds, MatrixView<Scalar> output_gradient,
                        std::span<Scalar> bounds_gradient);

// Replaces the raw log-variances `raw` (K x n) by the bounded lv, in place.
template <typename Scalar>
void BoundLogVariances(std::span<const Scalar> bounds, MatrixView<Scalar> raw);

// output = mean + exp(log_var / 2) * noise, all K x n; output may be mean.
template <typename Scalar>
void SampleGaussian(MatrixView<const Scalar> mean, MatrixView<const Scalar> log_var,
                    MatrixView<const Scalar> noise, MatrixView<Scalar> output);

}  // namespace b4mrl
