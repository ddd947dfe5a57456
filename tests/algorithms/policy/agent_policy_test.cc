#include "algorithms/policy/agent_policy.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <vector>

#include "algorithms/cores/h2o_core.h"
#include "algorithms/cores/iql_core.h"
#include "algorithms/cores/sac_core.h"
#include "algorithms/cores/td3_core.h"
#include "proto/base/rng.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

constexpr int kObservations = 5;
constexpr int kActions = 2;
constexpr int kRows = 7;

template <typename Core, typename Options>
PolicyWeights PolicyOf(int hidden_layers, Options options = {}) {
  options.observation_size = kObservations;
  options.action_size = kActions;
  options.hidden.assign(hidden_layers, 24);
  Result<Core> core = Core::Create(options);
  INFO(core.status().ToString());
  REQUIRE(core.ok());
  return core->Policy();
}

H2oOptions WithGapNoise() {
  H2oOptions options;
  options.gap_noise.assign(kObservations, 0.3);
  return options;
}

TEST_CASE("a core's policy of any depth acts with the same bits from its agent file") {
  const int depth = GENERATE(1, 2, 3, 8);
  const PolicyWeights weights = GENERATE_COPY(
      PolicyOf<SacCore<float>, SacOptions>(depth), PolicyOf<Td3Core<float>, Td3Options>(depth),
      PolicyOf<IqlCore<float>, IqlOptions>(depth), PolicyOf<H2oCore<float>>(depth, WithGapNoise()));
  REQUIRE(weights.hidden.size() == static_cast<size_t>(depth));
  const TemporaryFolder folder;
  const std::vector<float> scale(kActions, 1.0f);
  REQUIRE(WriteAgent(folder.File("agent.h5"), MakeAgent(weights, 1, scale)).ok());
  const Result<Agent> agent = ReadAgent(folder.File("agent.h5"));
  REQUIRE(agent.ok());
  CHECK(agent->hidden.size() == static_cast<size_t>(depth));
  const Result<AgentPolicy> read = AgentPolicy::Create(*agent);
  const Result<FixedOrderPolicy> made = FixedOrderPolicy::Create(weights);
  REQUIRE(read.ok());
  REQUIRE(made.ok());

  MatrixBuffer<float> observations(kObservations, kRows), expected(kActions, kRows);
  MatrixBuffer<float> actions(kActions, kRows);
  Rng rng(4, "agent-policy-test");
  rng.FillNormal(observations.values());
  made->Act(observations.view(), expected.view());
  read->Act(observations.view(), actions.view());
  CHECK(std::ranges::equal(actions.values(), expected.values()));
  CHECK(actions.view()(0, 0) != actions.view()(0, 1));  // the network reads its input
}

// The action for one observation, in double precision.
std::vector<double> TanhNetwork(const PolicyWeights& policy, std::vector<double> values) {
  std::vector<DenseWeights> layers = policy.hidden;
  layers.push_back(policy.mean);
  for (const DenseWeights& layer : layers) {
    std::vector<double> next(layer.bias.begin(), layer.bias.end());
    for (int o = 0; o < layer.outputs; ++o) {
      for (int k = 0; k < layer.inputs; ++k)
        next[o] += layer.weight[o * layer.inputs + k] * values[k];
      next[o] = std::tanh(next[o]);
    }
    values = next;
  }
  return values;
}

TEST_CASE("an agent whose hidden layers are tanh acts by the network's formula") {
  PolicyWeights weights = PolicyOf<Td3Core<float>, Td3Options>(3);
  weights.hidden_tanh = true;
  const TemporaryFolder folder;
  const std::vector<float> scale(kActions, 1.0f);
  REQUIRE(WriteAgent(folder.File("agent.h5"), MakeAgent(weights, 1, scale)).ok());
  const Result<Agent> agent = ReadAgent(folder.File("agent.h5"));
  REQUIRE(agent.ok());
  CHECK(agent->nonlinearity == Nonlinearity::kTanh);
  const Result<AgentPolicy> policy = AgentPolicy::Create(*agent);
  REQUIRE(policy.ok());
  MatrixBuffer<float> observations(kObservations, kRows), actions(kActions, kRows);
  Rng rng(4, "agent-policy-test");
  rng.FillNormal(observations.values());
  policy->Act(observations.view(), actions.view());
  for (int row = 0; row < kRows; ++row) {
    const float* observation = observations.view().column(row);
    const auto expected = TanhNetwork(weights, {observation, observation + kObservations});
    for (int k = 0; k < kActions; ++k) {
      // Four layers of at most 24 additions of numbers of order one, in float, and four tanh.
      CHECK(std::abs(actions.view()(k, row) - expected[k]) < 5e-6);
    }
  }
}

}  // namespace
}  // namespace b4mrl
