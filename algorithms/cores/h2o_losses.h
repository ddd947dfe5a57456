// The loss of H2O's critics (Niu et al. 2022): the error of a simulated transition is weighted by
// how likely the transition is under the real dynamics, and values are pushed down where the
// simulator is wrong. For each critic, with y from the target critics:
//
//   TD    mean over real (Q - y)^2 + mean over simulated w (Q - y)^2,
//         w = clamp(p_real / p_sim, ratio_min, 1) of the dynamics
//   gap   beta clamp(log sum over simulated omega exp(Q) - mean over real Q, -limit, limit),
//         omega = u / sum u,  u = clamp(dynamics gap, 1e-45, gap_max)
// w and omega are constants of the loss. log omega is computed in double: the smallest u is below
// the smallest normal float and would vanish in a sum of floats. Thread rule: pure functions.
#pragma once

#include <span>

#include "algorithms/nn/losses.h"
#include "algorithms/nn/products/view.h"

namespace b4mrl {

// Writes w of each simulated transition to `weights`, from log_ratios = log p_real / p_sim; returns
// the mean of w.
template <typename Scalar>
double DynamicsWeights(std::span<const Scalar> log_ratios, double ratio_min,
                       std::span<Scalar> weights);

// Writes log omega to `log_weights`, from estimates `gaps` of the dynamics gap in nats; returns the
// mean of u.
template <typename Scalar>
double LogGapWeights(std::span<const Scalar> gaps, double gap_max, std::span<double> log_weights);

// The TD loss and the mean of Q over all rows (CriticLoss), and both over real and over simulated
// rows alone. TD losses are summed, values of Q averaged over the critics.
struct HybridCriticLoss : CriticLoss {
  double real_loss = 0;
  double simulated_loss = 0;
  double mean_real_q = 0;
  double mean_simulated_q = 0;
};

// Computes the TD loss and mean Q; writes q_gradient (critics x n). The last weights.size() columns
// of q belong to simulated rows.
template <typename Scalar>
HybridCriticLoss HybridSquaredError(MatrixView<const Scalar> q, std::span<const Scalar> targets,
                                    std::span<const Scalar> weights, MatrixView<Scalar> q_gradient);

// Returns the gap penalty, summed over the critics, and adds its gradient to q_gradient.
template <typename Scalar>
double AddGapPenalty(MatrixView<const Scalar> q, std::span<const double> log_weights, double beta,
                     double limit, MatrixView<Scalar> q_gradient);

}  // namespace b4mrl
