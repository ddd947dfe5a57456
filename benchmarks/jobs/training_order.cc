#include "benchmarks/jobs/training_order.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <string_view>
#include <system_error>
#include <utility>

namespace b4mrl {
namespace {

// By which libraries know how many threads they may have. Of their own accord each learner would
// take all cores, and a runner starts one for each core.
constexpr const char* kThreadVariables[] = {"OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS",
                                            "MKL_NUM_THREADS"};

}  // namespace

uint64_t UpdatesToTrain(const PlannedRun& run, const std::optional<RunResult>& result,
                        uint32_t until_settled) {
  const bool goes_on = until_settled > 0 && !run.is_users();
  if (!goes_on || !result || result->updates < run.updates) return run.updates;
  if (result->finished && result->settled) return run.updates;  // perhaps under a larger budget
  // As often as it was told to train for its updates until now, and once more if it has not
  // settled.
  uint64_t times = (result->updates + run.updates - 1) / run.updates;
  if (result->updates % run.updates == 0 && result->finished && !result->settled) ++times;
  return run.updates * std::min<uint64_t>(times, until_settled + 1);
}

JobOrder TrainingOrder(const PlannedRun& run, const Budget& budget, uint64_t updates,
                       const std::string& folder, const std::vector<std::string>& daemon_words) {
  // By the run's own number, so that a run that goes on is evaluated at equal distances.
  const uint64_t every = std::max<uint64_t>(run.updates / budget.evaluations, 1);
  std::vector<std::string> words = {"train", "--quiet", "--resume"};
  const auto add = [&](std::string_view name, const auto& value) {
    words.push_back(fmt::format("--{}", name));
    words.push_back(fmt::format("{}", value));
  };
  add("algorithm", run.algorithm);
  add("environment", run.environment);
  if (!run.simulator.empty()) add("simulator", run.simulator);
  if (!run.world.empty()) add("world", run.world);
  if (!run.dataset.empty()) add("dataset", run.full_dataset);
  if (!run.corruption.empty()) add("corruption", run.corruption);
  add("seed", run.seed);
  add("precision", run.precision);
  add("updates", updates);
  add("eval-every", every);
  add("eval-episodes", budget.episodes);
  add("checkpoint-every", std::min<uint64_t>(every * 5, 10'000));
  add("threads", 1);
  for (const auto& [name, value] : run.hyperparameters) add(name, value);
  words.insert(words.end(), daemon_words.begin(), daemon_words.end());
  add("out", folder);
  return ToolOrder(std::move(words), folder + "/log");
}

JobOrder LearnerOrder(const PlannedRun& run, const std::string& folder, const LearnerPlace& place) {
  std::error_code error;
  JobOrder order = {
      .words = {"/bin/sh", "-c", run.learner},
      .log = folder + "/log",
      .environment = {"B4MRL_ENDPOINT=" + place.endpoint,
                      "B4MRL_BENCHMARK=" + run.benchmarks.front(),
                      "B4MRL_ENVIRONMENT=" + run.environment, "B4MRL_SIMULATOR=" + run.simulator,
                      "B4MRL_DATASET=" + run.full_dataset, "B4MRL_CORRUPTION=" + run.corruption,
                      "B4MRL_WORLD=" + run.world, fmt::format("B4MRL_SEED={}", run.seed),
                      fmt::format("B4MRL_UPDATES={}", run.updates),
                      fmt::format("B4MRL_LEDGER={}", place.ledger), "B4MRL_SUITES=" + place.suites,
                      "B4MRL_OUT=" + std::filesystem::absolute(folder, error).string()},
      .stops_group = true};
  for (const char* const name : kThreadVariables) {
    if (std::getenv(name) == nullptr) order.environment.push_back(fmt::format("{}=1", name));
  }
  return order;
}

}  // namespace b4mrl
