// The head of a probabilistic ensemble: bounded log-variances and the Gaussian loss.
//
// A member's output block has 2 K rows: K means, then K raw log-variances. All members share the
// soft bounds `bounds` = (max[K], min[K]) (Chua et al., "PETS", 2018, appendix A):
//   a = max - softplus(max - raw);  lv = min + softplus(a - min)
//   loss = sum over members of mean_{B,K}((mean - y)^2 exp(-lv)) + mean_{B,K}(lv)
// Pure functions. K is at most kEnsembleOutputsMax.
#pragma once

#include <span>

#include "algorithms/nn/products/view.h"

namespace b4mrl {

inline constexpr int kEnsembleOutputsMax = 1024;

// output: (members * 2 K) x n; targets: K x n (shared) or (members * K) x n. Returns the loss,
// writes output_gradient (like output) and adds to bounds_gradient (2 K).
template <typename Scalar>
double GaussianEnsembleLoss(int members, MatrixView<const Scalar> output,
                            MatrixView<const Scalar> targets, std::span<const Scalar> bounds,
                            MatrixView<Scalar> output_gradient, std::span<Scalar> bounds_gradient);

// raw (K x n) becomes lv, in place.
template <typename Scalar>
void BoundLogVariances(std::span<const Scalar> bounds, MatrixView<Scalar> raw);

// output = mean + exp(log_var / 2) * noise, all K x n; output may be mean.
template <typename Scalar>
void SampleGaussian(MatrixView<const Scalar> mean, MatrixView<const Scalar> log_var,
                    MatrixView<const Scalar> noise, MatrixView<Scalar> output);

}  // namespace b4mrl
