#include "algorithms/cores/h2o_losses.h"

#include <algorithm>
#include <cmath>

namespace b4mrl {
namespace {

constexpr double kSmallestGap = 1e-45;

// log sum over columns of exp(log_weights + the critic's q), with the largest exponent factored out
// so that nothing overflows.
template <typename Scalar>
double LogSumExp(MatrixView<const Scalar> q, int critic, std::span<const double> log_weights) {
  double largest = log_weights[0] + q(critic, 0);
  for (int i = 1; i < q.columns; ++i) {
    largest = std::max(largest, log_weights[i] + q(critic, i));
  }
  double sum = 0;
  for (int i = 0; i < q.columns; ++i) sum += std::exp(log_weights[i] + q(critic, i) - largest);
  return largest + std::log(sum);
}

}  // namespace

template <typename Scalar>
double DynamicsWeights(std::span<const Scalar> log_ratios, double ratio_min,
                       std::span<Scalar> weights) {
  const Scalar low = static_cast<Scalar>(std::log(ratio_min));
  for (size_t i = 0; i < weights.size(); ++i) {
    weights[i] = std::exp(std::clamp(log_ratios[i], low, Scalar(0)));
  }
  return Mean<Scalar>(weights);
}

template <typename Scalar>
double LogGapWeights(std::span<const Scalar> gaps, double gap_max, std::span<double> log_weights) {
  double sum = 0;
  for (size_t i = 0; i < gaps.size(); ++i) {
    const double u = std::clamp<double>(gaps[i], kSmallestGap, gap_max);
    log_weights[i] = std::log(u);
    sum += u;
  }
  const double log_sum = std::log(sum);
  for (double& weight : log_weights) weight -= log_sum;
  return sum / static_cast<double>(gaps.size());
}

template <typename Scalar>
HybridCriticLoss HybridSquaredError(MatrixView<const Scalar> q, std::span<const Scalar> targets,
                                    std::span<const Scalar> weights,
                                    MatrixView<Scalar> q_gradient) {
  HybridCriticLoss result;
  const int simulated = static_cast<int>(weights.size()), real = q.columns - simulated;
  for (int i = 0; i < q.columns; ++i) {
    const Scalar share = i < real ? Scalar(1) / static_cast<Scalar>(real)
                                  : weights[i - real] / static_cast<Scalar>(simulated);
    for (int critic = 0; critic < q.rows; ++critic) {
      const Scalar error = q(critic, i) - targets[i];
      q_gradient(critic, i) = 2 * share * error;
      const double loss = static_cast<double>(share) * error * error;
      result.loss += loss;
      result.mean_q += q(critic, i);
      (i < real ? result.real_loss : result.simulated_loss) += loss;
      (i < real ? result.mean_real_q : result.mean_simulated_q) += q(critic, i);
    }
  }
  result.mean_real_q /= static_cast<double>(q.rows) * real;
  result.mean_simulated_q /= static_cast<double>(q.rows) * simulated;
  result.mean_q /= static_cast<double>(q.rows) * q.columns;
  return result;
}

template <typename Scalar>
double AddGapPenalty(MatrixView<const Scalar> q, std::span<const double> log_weights, double beta,
                     double limit, MatrixView<Scalar> q_gradient) {
  const int simulated = static_cast<int>(log_weights.size()), real = q.columns - simulated;
  const MatrixView<const Scalar> simulated_q = q.ColumnBlock(real, simulated);
  double penalty = 0;
  for (int critic = 0; critic < q.rows; ++critic) {
    double mean_real = 0;
    for (int i = 0; i < real; ++i) mean_real += q(critic, i);
    mean_real /= real;
    const double log_sum_exp = LogSumExp(simulated_q, critic, log_weights);
    const double difference = log_sum_exp - mean_real;
    penalty += beta * std::clamp(difference, -limit, limit);
    if (std::abs(difference) > limit) continue;  // the clamped value is a constant
    for (int i = 0; i < real; ++i) q_gradient(critic, i) -= static_cast<Scalar>(beta / real);
    for (int i = 0; i < simulated; ++i) {
      const double share = std::exp(log_weights[i] + simulated_q(critic, i) - log_sum_exp);
      q_gradient(critic, real + i) += static_cast<Scalar>(beta * share);
    }
  }
  return penalty;
}

#define B4MRL_INSTANTIATE(Scalar)                                                                  \
  template double DynamicsWeights<Scalar>(std::span<const Scalar>, double, std::span<Scalar>);     \
  template double LogGapWeights<Scalar>(std::span<const Scalar>, double, std::span<double>);       \
  template HybridCriticLoss HybridSquaredError<Scalar>(                                            \
      MatrixView<const Scalar>, std::span<const Scalar>, std::span<const Scalar>,                  \
      MatrixView<Scalar>);                                                                         \
  template double AddGapPenalty<Scalar>(MatrixView<const Scalar>, std::span<const double>, double, \
                                        double, MatrixView<Scalar>);
B4MRL_INSTANTIATE(float)
B4MRL_INSTANTIATE(double)
#undef B4MRL_INSTANTIATE

}  // namespace b4mrl
