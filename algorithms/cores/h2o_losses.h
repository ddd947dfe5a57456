// The loss of H2O's critics (Niu et al. 2022): the error of a simulated transition counts by how
// likely the real dynamics would have made it, and values are pushed down where the simulator is
// wrong. For each critic, with y from the target critics:
//
//   TD    mean over real (Q - y)^2 + mean over simulated w (Q - y)^2,
//         w = clamp(p_real / p_sim, ratio_min, 1) of the dynamics
//   gap   beta clamp(log sum over simulated omega exp(Q) - mean over real Q, -limit, limit),
//         omega = u / sum u,  u = clamp(dynamics gap, 1e-45, gap_max)
// w and omega are constants of the loss. log omega is computed in double: the smallest u is below
// the smallest normal float, and its share in a sum of floats would vanish. Thread rule: pure
// functions.
#pragma once

#include <span>

#include "algorithms/nn/losses.h"
#include "algorithms/nn/products/view.h"

namespace b4mrl {

// weights = w; returns their mean.
template <typename Scalar>
double DynamicsWeights(std::span<const Scalar> log_ratios, double ratio_min,
                       std::span<Scalar> weights);

// log_weights = log omega from estimates of the gap; returns the mean of u.
template <typename Scalar>
double LogGapWeights(std::span<const Scalar> gaps, double gap_max, std::span<double> log_weights);

// TD and its two parts, and mean Q, in all rows and in each kind of rows; summed (TD) or averaged
// (Q) over the critics.
struct HybridCriticLoss : CriticLoss {
  double real_loss = 0;
  double simulated_loss = 0;
  double mean_real_q = 0;
  double mean_simulated_q = 0;
};

// TD, summed over the critics, and mean Q; writes q_gradient (critics x n). The simulated columns
// are the last weights.size() of q's.
template <typename Scalar>
HybridCriticLoss HybridSquaredError(MatrixView<const Scalar> q, std::span<const Scalar> targets,
                                    std::span<const Scalar> weights, MatrixView<Scalar> q_gradient);

// The gap term, summed over the critics; its gradient is added to q_gradient.
template <typename Scalar>
double AddGapPenalty(MatrixView<const Scalar> q, std::span<const double> log_weights, double beta,
                     double limit, MatrixView<Scalar> q_gradient);

}  // namespace b4mrl
