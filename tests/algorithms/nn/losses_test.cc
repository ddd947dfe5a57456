#include "algorithms/nn/losses.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <vector>

#include "tests/algorithms/finite_differences.h"

namespace b4mrl {
namespace {

MatrixBuffer<double> Normals(int rows, int columns, uint64_t stream) {
  MatrixBuffer<double> matrix(rows, columns);
  Rng rng(4, "losses-test", stream);
  rng.FillNormal(matrix.values());
  return matrix;
}

TEST_CASE("the critic loss has the gradient of its finite differences") {
  MatrixBuffer<double> q = Normals(2, 6, 0);
  MatrixBuffer<double> gradient(2, 6);
  const std::vector<double> targets = {0.5, -1, 2, 0, 0.1, 3};
  const auto loss = [&] {
    return SquaredErrorToTargets<double>(q.view(), targets, 0.5, gradient.view()).loss;
  };
  loss();
  const std::vector<double> analytic(gradient.values().begin(), gradient.values().end());
  CheckGradient(q.values(), analytic, loss);
}

TEST_CASE("the mean minimum has the gradient of its finite differences") {
  MatrixBuffer<double> q = Normals(2, 6, 1);
  MatrixBuffer<double> gradient(2, 6);
  const auto loss = [&] { return -MeanMinimum<double>(q.view(), gradient.view()); };
  loss();
  const std::vector<double> analytic(gradient.values().begin(), gradient.values().end());
  CheckGradient(q.values(), analytic, loss);
}

TEST_CASE("the mean squared error adds the gradient of its finite differences") {
  MatrixBuffer<double> prediction = Normals(3, 4, 2);
  const MatrixBuffer<double> target = Normals(3, 4, 3);
  MatrixBuffer<double> gradient(3, 4);
  const auto loss = [&] {
    MatrixBuffer<double> scratch(3, 4);
    return AddMeanSquaredError<double>(prediction.view(), target.view(), scratch.view());
  };
  gradient.view()(0, 0) = 7;
  AddMeanSquaredError<double>(prediction.view(), target.view(), gradient.view());
  gradient.view()(0, 0) -= 7;
  CheckGradient(prediction.values(), gradient.values(), loss);
}

TEST_CASE("a Bellman target cuts the future at a termination and takes the smaller critic") {
  MatrixBuffer<double> q(2, 2);
  q.view()(0, 0) = 4;
  q.view()(1, 0) = 3;
  q.view()(0, 1) = 4;
  q.view()(1, 1) = 5;
  const std::vector<double> rewards = {1, 2}, not_terminated = {1, 0}, log_probs = {-2, -2};
  std::vector<double> targets(2);
  const double mean =
      BellmanTargets<double>(q.view(), rewards, not_terminated, 0.5, log_probs, 0.1, targets);
  CHECK(targets[0] == Approx(1 + 0.5 * (3 + 0.2)));
  CHECK(targets[1] == 2);
  CHECK(mean == Approx((targets[0] + targets[1]) / 2));
  BellmanTargets<double>(q.view(), rewards, not_terminated, 0.5, {}, 0.1, targets);
  CHECK(targets[0] == Approx(2.5));
}

TEST_CASE("the mean of nothing is NaN, not zero") {
  CHECK(std::isnan(Mean<float>({})));
  CHECK(std::isnan(MeanMagnitude<float>({})));
}

}  // namespace
}  // namespace b4mrl
