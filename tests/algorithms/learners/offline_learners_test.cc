// Learners that train on a dataset alone, against a real daemon.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <utility>
#include <vector>

#include "algorithms/list.h"
#include "algorithms/policy/inference.h"
#include "tests/algorithms/fixtures.h"

namespace b4mrl {
namespace {

using Change = std::pair<std::string_view, double>;

// The policy of a small learner after a few updates, as numbers, behind its inputs' mean.
std::vector<float> Learned(TestDaemon& daemon, const Algorithm& algorithm,
                           std::vector<Change> changes) {
  LearnerContext context = CheetahContext(daemon, "HalfCheetah/small");
  context.hyperparameters = Hyperparameters(algorithm.hyperparameters);
  for (const Change& small : {Change{"hidden-width", 16}, Change{"batch-size", 32}}) {
    if (context.hyperparameters.Find(small.first) != nullptr)
      changes.insert(changes.begin(), small);
  }
  for (const auto& [name, value] : changes) RequireOk(context.hyperparameters.Set(name, value));
  const std::unique_ptr<Learner> learner = Take(algorithm.create(context));
  Progress quiet(true);
  RequireOk(learner->Prepare(quiet));
  MetricMeans metrics;
  for (int update = 0; update < 8; ++update) RequireOk(learner->Update(metrics));
  const PolicyWeights policy = learner->Policy();
  std::vector<float> numbers = policy.observation_mean;
  const std::vector<float> weights = FlattenPolicy(policy);
  numbers.insert(numbers.end(), weights.begin(), weights.end());
  return numbers;
}

// Values with which eight updates on two episodes go another way. What is not here is tried with
// OtherValue's.
constexpr Change kTelling[] = {
    {"expectile", 0.9},      {"temperature", 1},     {"weight-max", 0.5}, {"cosine-updates", 5},
    {"action-clip", 0.4},    {"bc-alpha", 1},        {"batch-size", 16},  {"hidden-width", 8},
    {"learning-rate", 1e-3}, {"gamma", 0.5},         {"tau", 0.5},        {"policy-noise", 1},
    {"noise-clip", 0.01},    {"policy-frequency", 1}};

// Another choice, the other position of a switch, or half of a number.
double OtherValue(const Hyperparameter& entry) {
  for (const auto& [name, value] : kTelling) {
    if (name == entry.name) return value;
  }
  if (!entry.choices.empty()) return entry.value == 0 ? 1 : 0;
  const double half = entry.value == 0 ? (entry.low + entry.high) / 2 : entry.value / 2;
  return std::clamp(entry.whole ? std::floor(half) : half, entry.low, entry.high);
}

TEST_CASE("Each hyperparameter of a learner on a dataset alone changes what it learns") {
  for (const Algorithm& algorithm : Algorithms()) {
    const Hyperparameters values(algorithm.hyperparameters);
    // Those that learn a model first: model_based_options_test.cc and mopo_test.cc.
    const bool has_model = values.Find("ensemble-members") != nullptr;
    if (!algorithm.needs.dataset || algorithm.needs.simulator || has_model) continue;
    DYNAMIC_SECTION(algorithm.name) {
      TestDaemon daemon;
      daemon.MakeDataset("small", 2000);  // two whole episodes
      const std::vector<float> original = Learned(daemon, algorithm, {});
      CHECK(Learned(daemon, algorithm, {}) == original);
      for (const Hyperparameter& entry : algorithm.hyperparameters) {
        const Change change = {entry.name, OtherValue(entry)};
        INFO(change.first << " = " << change.second);
        CHECK(Learned(daemon, algorithm, {change}) != original);
      }
    }
  }
}

// TD3-BC's step is compared with PyTorch's in td3_core_test.cc.
TEST_CASE("Behaviour cloning learns what TD3-BC's actor learns when values have no weight") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 500);
  const Algorithm& cloning = AlgorithmOf("bc");
  const Algorithm& with_values = AlgorithmOf("td3-bc");
  const std::vector<float> cloned = Learned(daemon, cloning, {});
  CHECK(cloned == Learned(daemon, with_values, {{"bc-alpha", 0}, {"policy-frequency", 1}}));
  CHECK(cloned != Learned(daemon, with_values, {{"policy-frequency", 1}}));
}

}  // namespace
}  // namespace b4mrl
