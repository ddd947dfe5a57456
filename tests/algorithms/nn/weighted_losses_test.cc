#include "algorithms/nn/weighted_losses.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <vector>

#include "tests/algorithms/finite_differences.h"

namespace b4mrl {
namespace {

constexpr int kActions = 3;
constexpr int kBatch = 5;

MatrixBuffer<double> Normals(int rows, int columns, uint64_t stream) {
  MatrixBuffer<double> matrix(rows, columns);
  Rng rng(4, "weighted-losses-test", stream);
  rng.FillNormal(matrix.values());
  return matrix;
}

const std::vector<double> kWeights = {0.5, 2, 0, 100, 1};

TEST_CASE("the expectile loss has the gradient of its finite differences") {
  MatrixBuffer<double> predictions = Normals(1, 20, 0);
  const MatrixBuffer<double> targets = Normals(1, 20, 1);
  std::vector<double> gradient(20);
  const auto loss = [&] {
    return ExpectileLoss<double>(predictions.values(), targets.values(), 0.7, gradient);
  };
  loss();
  CheckGradient(predictions.values(), std::vector<double>(gradient), loss);
}

TEST_CASE("the expectile loss weighs targets above the prediction by the expectile") {
  const std::vector<double> predictions = {1, 1}, targets = {3, -1};
  std::vector<double> gradient(2);
  CHECK(ExpectileLoss<double>(predictions, targets, 0.9, gradient) ==
        Approx((0.9 * 4 + 0.1 * 4) / 2));
  CHECK(gradient[0] == Approx(-2 * 0.9 * 2 / 2));
  CHECK(gradient[1] == Approx(2 * 0.1 * 2 / 2));
}

TEST_CASE("advantage weights are exponential up to the largest, and never infinite") {
  const std::vector<double> q = {1, 0, 5, 1e9}, v = {0, 1, 0, 0};
  std::vector<double> weights(4);
  const double mean = AdvantageWeights<double>(q, v, 3, 100, weights);
  CHECK(weights[0] == Approx(std::exp(3.0)));
  CHECK(weights[1] == Approx(std::exp(-3.0)));
  CHECK(weights[2] == 100);
  CHECK(weights[3] == 100);
  CHECK(mean == Approx((std::exp(3.0) + std::exp(-3.0) + 200) / 4));
}

TEST_CASE("a NaN advantage is not hidden by the largest weight") {
  const std::vector<double> q = {std::nan("")}, v = {0};
  std::vector<double> weights(1);
  CHECK(std::isnan(AdvantageWeights<double>(q, v, 3, 100, weights)));
  CHECK(std::isnan(weights[0]));
}

TEST_CASE("the weighted squared error has the gradient of its finite differences") {
  MatrixBuffer<double> prediction = Normals(kActions, kBatch, 2);
  const MatrixBuffer<double> target = Normals(kActions, kBatch, 3);
  MatrixBuffer<double> gradient(kActions, kBatch);
  const auto loss = [&] {
    return WeightedSquaredError<double>(prediction.view(), target.view(), kWeights,
                                        gradient.view());
  };
  loss();
  const std::vector<double> analytic(gradient.values().begin(), gradient.values().end());
  CheckGradient(prediction.values(), analytic, loss);
}

TEST_CASE("the weighted Gaussian loss has the gradients of its finite differences") {
  MatrixBuffer<double> mean = Normals(kActions, kBatch, 4);
  const MatrixBuffer<double> target = Normals(kActions, kBatch, 5);
  // The outer two are beyond the clamps, where nothing may pass.
  std::vector<double> log_std = {-6, 0.3, 2.5};
  MatrixBuffer<double> mean_gradient(kActions, kBatch);
  std::vector<double> log_std_gradient(kActions);
  const auto loss = [&] {
    return WeightedGaussianLoss<double>(mean.view(), log_std, {}, target.view(), kWeights,
                                        mean_gradient.view(), log_std_gradient);
  };
  loss();
  const std::vector<double> of_mean(mean_gradient.values().begin(), mean_gradient.values().end());
  const std::vector<double> of_log_std = log_std_gradient;
  CHECK(of_log_std[0] == 0);
  CHECK(of_log_std[1] != 0);
  CHECK(of_log_std[2] == 0);
  CheckGradient(mean.values(), of_mean, loss);
  CheckGradient(log_std, of_log_std, loss);
}

TEST_CASE("the weighted Gaussian loss is the density's") {
  // One action of mean 1 and deviation e^0.5 at 2: log N = -(1/e)/2 - 0.5 - log(2 pi)/2.
  MatrixBuffer<double> mean(1, 1), target(1, 1), gradient(1, 1);
  mean.view()(0, 0) = 1;
  target.view()(0, 0) = 2;
  const std::vector<double> log_std = {0.5}, weights = {3};
  std::vector<double> log_std_gradient(1);
  CHECK(WeightedGaussianLoss<double>(mean.view(), log_std, {}, target.view(), weights,
                                     gradient.view(), log_std_gradient) ==
        Approx(3 * (0.5 / std::exp(1.0) + 0.5 + 0.5 * std::log(2 * 3.14159265358979))));
}

TEST_CASE("column minima are taken over the rows of each column") {
  MatrixBuffer<double> q(2, 2);
  q.view()(0, 0) = 4;
  q.view()(1, 0) = 3;
  q.view()(0, 1) = -4;
  q.view()(1, 1) = 5;
  std::vector<double> minima(2);
  ColumnMinima<double>(q.view(), minima);
  CHECK(minima == std::vector<double>{3, -4});
}

}  // namespace
}  // namespace b4mrl
