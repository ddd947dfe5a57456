// Finite differences through every loss of H2O. With all learning rates zero an update changes no
// parameter, so its losses are functions of the parameters.
#include <catch2/catch.hpp>
#include <cmath>
#include <vector>

#include "algorithms/cores/h2o_core.h"
#include "algorithms/cores/h2o_losses.h"
#include "tests/algorithms/finite_differences.h"
#include "tests/algorithms/random_batch.h"

namespace b4mrl {
namespace {

constexpr int kObservations = 4;
constexpr int kActions = 2;
constexpr int kReal = 4;
constexpr int kSimulated = 3;
constexpr int kBatch = kReal + kSimulated;

MatrixBuffer<double> Normals(int rows, int columns, uint64_t stream) {
  MatrixBuffer<double> matrix(rows, columns);
  Rng rng(12, "h2o-gradients-test", stream);
  rng.FillNormal(matrix.values());
  return matrix;
}

H2oOptions FrozenOptions() {
  H2oOptions options;
  options.observation_size = kObservations;
  options.action_size = kActions;
  options.hidden = GENERATE(values<std::vector<int>>({{9}, {9, 8}, {9, 8, 7}}));
  options.batch_max = kBatch;
  options.discriminator_batch_max = kBatch;
  options.actor_learning_rate = options.critic_learning_rate = options.alpha_learning_rate = 0;
  options.discriminator_learning_rate = 0;
  options.tau = 0;
  options.initial_alpha = 0.4;
  options.head_gain = 1;  // or every value and its gradient would be near zero
  options.gap_weight = 0.5;
  options.gap_samples = 2;
  options.gap_noise.assign(kObservations, 0.3);
  return options;
}

struct Fixture {
  explicit Fixture(const H2oOptions& options) : core(H2oCore<double>::Create(options).value()) {}

  H2oMetrics Update() {
    return core.Update({batch.Views(), kReal}, {discriminator_batch.Views(), kReal},
                       {discriminator_noise.view(), gap_noise.view(), noise.view()});
  }

  H2oCore<double> core;
  RandomBatch<double> batch{kObservations, kActions, kBatch, 1};
  RandomBatch<double> discriminator_batch{kObservations, kActions, kBatch, 2};
  MatrixBuffer<double> discriminator_noise = Normals(2 * kObservations + kActions, kBatch, 0);
  MatrixBuffer<double> gap_noise = Normals(kObservations, 2 * kSimulated, 1);
  MatrixBuffer<double> noise = Normals(kActions, 2 * kBatch, 2);
};

TEST_CASE("H2O's losses have the gradients of their finite differences") {
  Fixture f(FrozenOptions());
  CheckGradientsOf("critic/", f.core, [&] {
    const H2oMetrics metrics = f.Update();
    return metrics.sac.critic_loss + metrics.gap_penalty;
  });
  // "actor/" includes the scale and the offset of log_std.
  CheckGradientsOf("actor/", f.core, [&] { return f.Update().sac.actor_loss; });
  CheckGradientsOf("actor/log_std_scale", f.core, [&] { return f.Update().sac.actor_loss; });
  CheckGradientsOf("log_alpha", f.core, [&] { return f.Update().sac.alpha_loss; });
  CheckGradientsOf("d_sas/", f.core, [&] { return f.Update().discriminators.transition_loss; });
  CheckGradientsOf("d_sa/", f.core, [&] {
    const DiscriminatorMetrics metrics = f.Update().discriminators;
    return metrics.state_action_loss + metrics.transition_loss;
  });
}

TEST_CASE("the hybrid error has the gradient of its finite differences") {
  MatrixBuffer<double> q = Normals(2, kBatch, 4), gradient(2, kBatch);
  const std::vector<double> targets = {0.5, -1, 2, 0, 0.1, 3, -0.4}, weights = {1, 0.3, 1e-5};
  const auto loss = [&] {
    return HybridSquaredError<double>(q.view(), targets, weights, gradient.view()).loss;
  };
  loss();
  const std::vector<double> analytic(gradient.values().begin(), gradient.values().end());
  CheckGradient(q.values(), analytic, loss);
}

TEST_CASE("the hybrid error and mean Q are told apart by where rows come from") {
  MatrixBuffer<double> q(2, 3), gradient(2, 3);
  const std::vector<double> values = {1, 3, 5, 7, 10, 20};  // two critics a column
  std::copy(values.begin(), values.end(), q.values().begin());
  const std::vector<double> targets = {0, 0, 0}, weights = {0.5};
  const HybridCriticLoss loss =
      HybridSquaredError<double>(q.view(), targets, weights, gradient.view());
  CHECK(loss.mean_real_q == Approx(4));
  CHECK(loss.mean_simulated_q == Approx(15));
  CHECK(loss.mean_q == Approx(46.0 / 6));
  CHECK(loss.real_loss == Approx((1 + 9 + 25 + 49) / 2.0));
  CHECK(loss.simulated_loss == Approx(0.5 * (100 + 400)));
  CHECK(loss.loss == Approx(loss.real_loss + loss.simulated_loss));
}

TEST_CASE("the gap penalty adds the gradient of its finite differences") {
  MatrixBuffer<double> q = Normals(2, kBatch, 5), gradient(2, kBatch);
  std::vector<double> log_weights(kSimulated);
  LogGapWeights<double>(std::vector<double>{0.5, 1.5, -2}, 10, log_weights);
  const auto penalty = [&] {
    MatrixBuffer<double> scratch(2, kBatch);
    return AddGapPenalty<double>(q.view(), log_weights, 0.25, 1000, scratch.view());
  };
  gradient.view()(0, 0) = 7;
  AddGapPenalty<double>(q.view(), log_weights, 0.25, 1000, gradient.view());
  gradient.view()(0, 0) -= 7;
  CheckGradient(q.values(), gradient.values(), penalty);
}

TEST_CASE("a clamped gap penalty is constant") {
  MatrixBuffer<double> q = Normals(1, kBatch, 6), gradient(1, kBatch);
  for (int i = kReal; i < kBatch; ++i) q.view()(0, i) = 5000;
  std::vector<double> log_weights(kSimulated);
  LogGapWeights<double>(std::vector<double>{1, 1, 1}, 10, log_weights);
  CHECK(AddGapPenalty<double>(q.view(), log_weights, 0.01, 1000, gradient.view()) == Approx(10));
  for (const double slope : gradient.values()) CHECK(slope == 0);
}

TEST_CASE("values of a thousand and more keep the gap penalty finite") {
  MatrixBuffer<float> q(1, kBatch), gradient(1, kBatch);
  for (int i = 0; i < kBatch; ++i) q.view()(0, i) = 9000.0f + static_cast<float>(i);
  std::vector<double> log_weights(kSimulated);
  LogGapWeights<float>(std::vector<float>{1, 1, 1}, 10, log_weights);
  // log mean exp(9004, 9005, 9006) - mean(9000, ..., 9003)
  const double expected = 9006 + std::log((1 + std::exp(-1.0) + std::exp(-2.0)) / 3) - 9001.5;
  CHECK(AddGapPenalty<float>(q.view(), log_weights, 1, 1000, gradient.view()) == Approx(expected));
}

TEST_CASE("gaps below zero weigh as little as the smallest positive ones, and nothing is lost") {
  std::vector<double> log_weights(3);
  LogGapWeights<float>(std::vector<float>{2, -1, 40}, 10, log_weights);
  CHECK(log_weights[0] == Approx(std::log(2.0 / 12)));
  CHECK(log_weights[1] == Approx(std::log(1e-45) - std::log(12)));
  CHECK(log_weights[2] == Approx(std::log(10.0 / 12)));
  // All of them so small: equal shares, where floats would underflow to 0 / 0.
  LogGapWeights<float>(std::vector<float>{-1, -2, -3}, 10, log_weights);
  for (const double weight : log_weights) CHECK(weight == Approx(-std::log(3.0)));
}

TEST_CASE("simulated transitions weigh at most as much as real ones") {
  std::vector<double> weights(3);
  const std::vector<double> log_ratios = {1.5, std::log(0.25), -40};
  const double mean = DynamicsWeights<double>(log_ratios, 1e-5, weights);
  CHECK(weights[0] == 1);
  CHECK(weights[1] == Approx(0.25));
  CHECK(weights[2] == Approx(1e-5));
  CHECK(mean == Approx((1.25 + 1e-5) / 3));
}

}  // namespace
}  // namespace b4mrl
