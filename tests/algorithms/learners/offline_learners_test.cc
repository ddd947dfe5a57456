// Learners that train on a dataset alone, against a real daemon.
#include <catch2/catch.hpp>
#include <string>
#include <utility>
#include <vector>

#include "algorithms/list.h"
#include "algorithms/rl/policy_numbers.h"
#include "tests/algorithms/learners/fixtures.h"

namespace b4mrl {
namespace {

using Change = std::pair<std::string_view, double>;

// The policy of a small learner after a few updates, as numbers, behind its inputs' mean.
std::vector<float> Learned(TestDaemon& daemon, const Algorithm& algorithm,
                           std::vector<Change> changes) {
  LearnerContext context = CheetahContext(daemon, "HalfCheetah/small");
  context.hyperparameters = Hyperparameters(algorithm.hyperparameters);
  changes.insert(changes.begin(), {{"hidden-width", 16}, {"batch-size", 32}});
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

void CheckThatEachChanges(const std::string& name, const std::vector<Change>& changes) {
  const Algorithm* algorithm = Take(FindAlgorithm(name));
  TestDaemon daemon;
  daemon.MakeDataset("small", 2000);  // two whole episodes
  const std::vector<float> original = Learned(daemon, *algorithm, {});
  CHECK(Learned(daemon, *algorithm, {}) == original);
  CHECK(changes.size() == algorithm->hyperparameters.size());
  for (const Change& change : changes) {
    INFO(change.first);
    CHECK(Learned(daemon, *algorithm, {change}) != original);
  }
}

TEST_CASE("Each hyperparameter of IQL changes what it learns") {
  CheckThatEachChanges("iql", {{"actor", 1},
                               {"initialisation", 1},
                               {"expectile", 0.9},
                               {"temperature", 1},
                               {"weight-max", 0.5},
                               {"cosine-updates", 5},
                               {"normalise", 0},
                               {"reward-scaling", 1},
                               {"action-clip", 0.4},
                               {"batch-size", 16},
                               {"hidden-width", 8},
                               {"learning-rate", 1e-3},
                               {"gamma", 0.5},
                               {"tau", 0.5}});
}

TEST_CASE("Each hyperparameter of TD3-BC changes what it learns") {
  CheckThatEachChanges("td3-bc", {{"bc-alpha", 1},
                                  {"batch-size", 16},
                                  {"hidden-width", 8},
                                  {"learning-rate", 1e-3},
                                  {"gamma", 0.5},
                                  {"tau", 0.5},
                                  {"policy-noise", 1},
                                  {"noise-clip", 0.01},
                                  {"policy-frequency", 1},
                                  {"normalise", 0}});
}

}  // namespace
}  // namespace b4mrl
