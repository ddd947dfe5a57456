// What the options of a run decide, and what its agent and its result say about them.
#include <atomic>
#include <catch2/catch.hpp>
#include <filesystem>
#include <numeric>
#include <span>
#include <string>
#include <vector>

#include "data/d4rl/agent_file.h"
#include "tests/algorithms/logged_rows.h"
#include "tests/algorithms/run/small_run.h"
#include "tests/algorithms/test_daemon.h"

namespace b4mrl {
namespace {

// What a run with these options learned.
std::vector<float> Learned(TestDaemon& daemon, TrainOptions options) {
  static int runs = 0;
  options.folder = daemon.folder("run" + std::to_string(runs++));
  return Take(ReadAgent(RunTraining(options, daemon.client()).agent_path)).last_fc.weight;
}

double Mean(std::span<const double> values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

}  // namespace

TEST_CASE("How a run sees its dataset, and how it computes, decide what it learns") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 500);
  TrainOptions options = SmallRun("td3-bc", "");
  options.corruption = "obs-noise-high";
  TrainOptions other = options;
  SECTION("the seed of its noise") { other.corruption_seed = 1; }
  SECTION("the rule for next observations") { other.transitions = "d4rl"; }
  SECTION("the precision") {
    if (!HasBf16()) {
      WARN("skipped: this processor has no AVX512-BF16");
      return;
    }
    other.precision = Precision::kBf16;
  }
  const std::vector<float> learned = Learned(daemon, options);
  CHECK(Learned(daemon, options) == learned);
  CHECK(Learned(daemon, other) != learned);
}

TEST_CASE("A simulator without queries is refused to who asks them before the run has a folder") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 500);
  TrainOptions options = SmallRun("hymopo", daemon.folder("run"));
  options.simulator = "action-delay";
  const std::atomic<bool> stop = false;
  Progress quiet(true);
  const Status refused = Train(options, daemon.client(), quiet, stop).status();
  CHECK(refused.code() == StatusCode::kUnsupported);
  CHECK(refused.message().find("action-delay") != std::string::npos);
  CHECK_FALSE(std::filesystem::exists(options.folder));
  // Learners that step it can have it.
  TrainOptions steps = SmallRun("h2o", daemon.folder("steps"));
  steps.simulator = "action-delay";
  CHECK(RunTraining(steps, daemon.client()).updates == steps.updates);
}

TEST_CASE("An agent names the run that it comes from") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 500);
  TrainOptions options = SmallRun("h2o", daemon.folder("run"));
  options.corruption = "hidden=9";
  options.command = "b4mrl train h2o";
  const TrainSummary summary = RunTraining(options, daemon.client());
  const AgentProvenance provenance = Take(ReadAgent(summary.agent_path)).provenance;
  CHECK(provenance.environment == options.environment);
  CHECK(provenance.algorithm == options.algorithm);
  CHECK(provenance.seed == options.seed);
  CHECK(provenance.updates == options.updates);
  CHECK(provenance.command == options.command);
  CHECK(provenance.simulator == options.simulator);
  CHECK(provenance.corruption == options.corruption);
  CHECK(provenance.dataset == summary.dataset.full_name);
  CHECK(provenance.dataset.find(options.dataset) == 0);  // before its version
  CHECK(provenance.dataset_sha256 == summary.dataset.sha256);
  CHECK(provenance.dataset_sha256.size() == 64);
}

TEST_CASE("A run's result has the mean of its last ten evaluations") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 500);
  TrainOptions options = SmallRun("td3-bc", daemon.folder("run"));
  options.eval_every = 5;
  const TrainSummary summary = RunTraining(options, daemon.client());
  std::vector<double> returns;
  for (const nlohmann::json& row : LoggedRows(options.folder)) {
    if (row.contains("evaluation_return")) returns.push_back(row["evaluation_return"]);
  }
  REQUIRE(returns.size() == 12);
  // The logs keep nine digits.
  const double expected = Mean(std::span(returns).last(10));
  CHECK(summary.mean_return_of_last_ten == Approx(expected).epsilon(1e-8));
  CHECK(Mean(returns) != Approx(expected).epsilon(1e-8));
}

}  // namespace b4mrl
