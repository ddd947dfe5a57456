#include "algorithms/policy/inference.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

#include "proto/base/rng.h"

namespace b4mrl {
namespace {

DenseWeights RandomLayer(int inputs, int outputs, Rng& rng) {
  DenseWeights layer{.inputs = inputs, .outputs = outputs};
  const double bound = 1 / std::sqrt(static_cast<double>(inputs));
  for (int i = 0; i < inputs * outputs; ++i) {
    layer.weight.push_back(static_cast<float>(rng.Uniform(-bound, bound)));
  }
  for (int i = 0; i < outputs; ++i) {
    layer.bias.push_back(static_cast<float>(rng.Uniform(-bound, bound)));
  }
  return layer;
}

PolicyWeights RandomPolicy(int observations, const std::vector<int>& hidden, int actions) {
  Rng rng(8, "inference-test");
  PolicyWeights weights;
  weights.observation_size = observations;
  weights.action_size = actions;
  int inputs = observations;
  for (const int width : hidden) {
    weights.hidden.push_back(RandomLayer(inputs, width, rng));
    inputs = width;
  }
  weights.mean = RandomLayer(inputs, actions, rng);
  weights.log_std = RandomLayer(inputs, actions, rng);
  return weights;
}

std::vector<double> Apply(const DenseWeights& layer, const std::vector<double>& x, bool relu) {
  std::vector<double> y(layer.bias.begin(), layer.bias.end());
  for (int o = 0; o < layer.outputs; ++o) {
    for (int k = 0; k < layer.inputs; ++k) {
      y[o] += static_cast<double>(layer.weight[o * layer.inputs + k]) * x[k];
    }
    if (relu) y[o] = std::max(y[o], 0.0);
  }
  return y;
}

FixedOrderPolicy Make(const PolicyWeights& weights) {
  Result<FixedOrderPolicy> policy = FixedOrderPolicy::Create(weights);
  INFO(policy.status().ToString());
  REQUIRE(policy.ok());
  return std::move(policy).value();
}

MatrixBuffer<float> Normals(int rows, int columns, uint64_t stream) {
  MatrixBuffer<float> matrix(rows, columns);
  Rng rng(9, "inference-test", stream);
  rng.FillNormal(matrix.values());
  return matrix;
}

TEST_CASE("fixed-order actions and log-densities agree with a computation in double") {
  // Sizes that fill no register: padding must not leak into results.
  const PolicyWeights weights = GENERATE(RandomPolicy(17, {256, 256}, 6), RandomPolicy(3, {5}, 1),
                                         RandomPolicy(11, {33, 17, 40}, 19));
  const FixedOrderPolicy policy = Make(weights);
  constexpr int kRows = 101;
  const MatrixBuffer<float> observations = Normals(weights.observation_size, kRows, 0);
  const MatrixBuffer<float> noise = Normals(weights.action_size, kRows, 1);
  MatrixBuffer<float> sampled(weights.action_size, kRows), greedy(weights.action_size, kRows);
  std::vector<float> log_probs(kRows);
  policy.Sample(observations.view(), noise.view(), sampled.view(), log_probs);
  policy.Act(observations.view(), greedy.view());
  for (int row = 0; row < kRows; ++row) {
    const float* observation = observations.view().column(row);
    std::vector<double> x(observation, observation + weights.observation_size);
    for (const DenseWeights& layer : weights.hidden) x = Apply(layer, x, true);
    const std::vector<double> mean = Apply(weights.mean, x, false);
    const std::vector<double> log_std = Apply(*weights.log_std, x, false);
    double log_prob = 0;
    for (int k = 0; k < weights.action_size; ++k) {
      const double e = noise.view()(k, row);
      const double a = std::tanh(mean[k] + std::exp(log_std[k]) * e);
      log_prob += -e * e / 2 - log_std[k] - 0.9189385332 - std::log(1 - a * a + 1e-6);
      // Chains of at most 257 float additions on numbers of order one, then tanh.
      CHECK(std::abs(sampled.view()(k, row) - a) < 2e-6);
      CHECK(std::abs(greedy.view()(k, row) - std::tanh(mean[k])) < 2e-6);
    }
    // log(1 - a^2) multiplies an error of a by up to 2 / (1 - a^2).
    CHECK(log_probs[row] == Approx(log_prob).epsilon(1e-3).margin(1e-3));
  }
}

TEST_CASE("a policy that is assigned other weights has the bits of a policy made of them") {
  const PolicyWeights first = RandomPolicy(17, {256, 256}, 6);
  // Equal shapes, as in training, and others: fewer outputs than a panel has, and no log_std.
  PolicyWeights second = GENERATE(RandomPolicy(17, {256, 256}, 6), RandomPolicy(17, {33, 5}, 6));
  for (float& weight : second.hidden[0].weight) weight *= 0.5f;
  if (GENERATE(true, false)) second.log_std.reset();
  second.observation_mask.assign(17, 1.0f);
  second.observation_mask[3] = 0;
  FixedOrderPolicy policy = Make(first);
  REQUIRE(policy.Assign(second).ok());
  const FixedOrderPolicy expected = Make(second);
  CHECK(policy.stochastic() == expected.stochastic());
  const MatrixBuffer<float> observations = Normals(17, 5, 0);
  MatrixBuffer<float> actions(6, 5), expected_actions(6, 5);
  policy.Act(observations.view(), actions.view());
  expected.Act(observations.view(), expected_actions.view());
  CHECK(std::ranges::equal(actions.values(), expected_actions.values()));

  // Weights that training has made infinite are refused, and the policy stays as it was.
  PolicyWeights diverged = second;
  diverged.mean.weight.back() = std::numeric_limits<float>::infinity();
  CHECK(policy.Assign(diverged).code() == StatusCode::kInvalidArgument);
  policy.Act(observations.view(), actions.view());
  CHECK(std::ranges::equal(actions.values(), expected_actions.values()));
}

TEST_CASE("a row's bits do not depend on the batch around it") {
  const PolicyWeights weights = RandomPolicy(17, {256, 256}, 6);
  const FixedOrderPolicy policy = Make(weights);
  constexpr int kRows = 131;
  const MatrixBuffer<float> observations = Normals(17, kRows, 2);
  const MatrixBuffer<float> noise = Normals(6, kRows, 3);
  MatrixBuffer<float> together(6, kRows), pieces(6, kRows);
  std::vector<float> together_log_probs(kRows), pieces_log_probs(kRows);
  policy.Sample(observations.view(), noise.view(), together.view(), together_log_probs);
  const int piece = GENERATE(1, 2, 5, 6, 7, 48, 64);
  for (int first = 0; first < kRows; first += piece) {
    const int count = std::min(piece, kRows - first);
    policy.Sample(observations.view().ColumnBlock(first, count),
                  noise.view().ColumnBlock(first, count), pieces.view().ColumnBlock(first, count),
                  std::span<float>(pieces_log_probs).subspan(first, count));
  }
  CHECK(std::memcmp(together.values().data(), pieces.values().data(),
                    together.values().size_bytes()) == 0);
  CHECK(together_log_probs == pieces_log_probs);
}

// A network that passes its one input through, so that the action is tanh(observation).
PolicyWeights Identity() {
  PolicyWeights weights;
  weights.observation_size = weights.action_size = 1;
  weights.mean = {.inputs = 1, .outputs = 1, .weight = {1}, .bias = {0}};
  return weights;
}

TEST_CASE("our tanh is accurate from the smallest to the largest arguments") {
  const FixedOrderPolicy policy = Make(Identity());
  MatrixBuffer<float> x(1, 1), a(1, 1);
  for (double magnitude = 1e-30; magnitude < 1e30; magnitude *= 1.05) {
    for (const double sign : {-1.0, 1.0}) {
      x.view()(0, 0) = static_cast<float>(sign * magnitude);
      policy.Act(x.view(), a.view());
      const double expected = std::tanh(static_cast<double>(x.view()(0, 0)));
      CHECK(std::abs(a.view()(0, 0) - expected) <= 4e-7 * std::abs(expected));
    }
  }
}

TEST_CASE("the bits of the actions are the recorded ones") {
  // Datasets and scores are promised to be equal on every processor with AVX2 and FMA. Another
  // value here means that they no longer are, or that every data set made before has changed.
  const PolicyWeights weights = RandomPolicy(17, {256, 256}, 6);
  const FixedOrderPolicy policy = Make(weights);
  const MatrixBuffer<float> observations = Normals(17, 64, 4);
  const MatrixBuffer<float> noise = Normals(6, 64, 5);
  MatrixBuffer<float> actions(6, 64);
  std::vector<float> log_probs(64);
  policy.Sample(observations.view(), noise.view(), actions.view(), log_probs);
  uint64_t hash = 0;
  for (const std::span<const float> values :
       {std::span<const float>(actions.values()), std::span<const float>(log_probs)}) {
    for (const float value : values) {
      uint32_t bits = 0;
      std::memcpy(&bits, &value, sizeof(bits));
      hash = MixSeeds(hash, bits);
    }
  }
  CHECK(hash == 0xd3a63475ad82a7b6ull);
}

TEST_CASE("NaN observations give NaN actions, hidden dimensions are never read") {
  PolicyWeights weights = RandomPolicy(4, {8}, 2);
  weights.observation_mean = {0, 1, 2, 3};
  weights.observation_std = {1, 2, 1, 2};
  MatrixBuffer<float> observation = Normals(4, 1, 6);
  MatrixBuffer<float> actions(2, 1), masked(2, 1);
  observation.view()(1, 0) = std::numeric_limits<float>::quiet_NaN();
  Make(weights).Act(observation.view(), actions.view());
  CHECK(std::isnan(actions.view()(0, 0)));
  weights.observation_mask = {1, 0, 1, 1};
  Make(weights).Act(observation.view(), actions.view());
  observation.view()(1, 0) = 1;  // the mean: zero after normalisation
  weights.observation_mask.clear();
  Make(weights).Act(observation.view(), masked.view());
  CHECK(actions.view()(0, 0) == masked.view()(0, 0));
  CHECK(std::isfinite(masked.view()(0, 0)));
}

TEST_CASE("weights that do not fit together are refused by name") {
  PolicyWeights weights = RandomPolicy(4, {8}, 2);
  SECTION("a layer of other width") {
    weights.mean.inputs = 9;
    CHECK(FixedOrderPolicy::Create(weights).status().message().find("mean.inputs") !=
          std::string::npos);
  }
  SECTION("too few numbers") {
    weights.hidden[0].weight.pop_back();
    CHECK(FixedOrderPolicy::Create(weights).status().message().find("hidden[0].weight") !=
          std::string::npos);
  }
  SECTION("a NaN weight") { weights.log_std->bias[0] = std::nanf(""); }
  SECTION("a zero deviation") { weights.observation_std = {1, 1, 0, 1}; }
  SECTION("a mask that is no mask") { weights.observation_mask = {1, 1, 0.5, 1}; }
  SECTION("a mean of other length") { weights.observation_mean = {1}; }
  SECTION("no observation") { weights.observation_size = 0; }
  SECTION("an overflowing size") { weights.observation_size = std::numeric_limits<int>::max(); }
  CHECK(FixedOrderPolicy::Create(weights).status().code() == StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace b4mrl
