// Which agent's scores a run's result tells, whenever it is stopped.
#include <atomic>
#include <catch2/catch.hpp>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "algorithms/base/checkpoint.h"
#include "data/d4rl/agent_file.h"
#include "tests/algorithms/run/small_run.h"
#include "tests/algorithms/test_daemon.h"

namespace b4mrl {
namespace {

nlohmann::json ResultOf(const TrainOptions& options) {
  return nlohmann::json::parse(ReadBytes(options.folder + "/result.json"));
}

TrainSummary RunAndStop(const TrainOptions& options, Client& client) {
  const std::atomic<bool> stop = true;  // before the first update
  Progress quiet(true);
  return Take(Train(options, client, quiet, stop));
}

TEST_CASE("A run that goes on and is stopped keeps the scores of its last evaluation") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 500);
  TrainOptions options = SmallRun("td3-bc", daemon.folder("run"));
  options.updates = 45;  // where a longer run evaluates nothing, so no checkpoint has this one
  CHECK(RunTraining(options, daemon.client()).last_updates == 45);
  const nlohmann::json before = ResultOf(options);
  options.updates = 60;
  options.resume = true;
  const TrainSummary stopped = RunAndStop(options, daemon.client());
  CHECK(stopped.state == RunState::kInterrupted);
  CHECK(stopped.last_updates == 45);
  CHECK(Take(ReadAgent(stopped.agent_path)).provenance.updates == 45);
  const nlohmann::json after = ResultOf(options);
  for (const char* name : {"agent", "evaluation_updates", "returns", "mean_return", "std_return",
                           "score", "mean_return_of_last_ten", "mean_score_of_last_ten"}) {
    INFO(name);
    CHECK(after[name] == before[name]);
  }
  nlohmann::json wrong = before;
  wrong["evaluation_updates"] = -1;
  WriteBytes(options.folder + "/result.json", wrong.dump());
  CHECK(RunAndStop(options, daemon.client()).last_updates == 30);  // the checkpoint's
  CHECK(RunTraining(options, daemon.client()).last_updates == 60);
  CHECK(ResultOf(options)["evaluation_updates"] == 60);
}

TEST_CASE("A result names no agent of an evaluation that a kill has cut off") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 500);
  TrainOptions options = SmallRun("td3-bc", daemon.folder("run"));
  const TrainSummary whole = RunTraining(options, daemon.client());
  const std::string agent = ReadBytes(whole.agent_path);
  // As if the process had been killed between the evaluation at 60 and its checkpoint.
  std::filesystem::remove(CheckpointPath(options.folder, 60));
  WriteBytes(options.folder + "/result.json", R"({"state":"running","reason":"","updates":0})");
  options.resume = true;
  const TrainSummary stopped = RunAndStop(options, daemon.client());
  CHECK(stopped.last_updates == 30);
  CHECK(stopped.agent_path.empty());
  CHECK_FALSE(ResultOf(options).contains("agent"));
  CHECK_FALSE(std::filesystem::exists(options.folder + "/agent.h5"));
  const TrainSummary resumed = RunTraining(options, daemon.client());
  CHECK(resumed.last_updates == 60);
  CHECK(ResultOf(options)["agent"] == resumed.agent_path);
  CHECK((ReadBytes(resumed.agent_path) == agent));
}

TEST_CASE("A run without updates that is stopped as it prepares has not finished") {
  TestDaemon daemon;
  TrainOptions options = SmallRun("sac", daemon.folder("run"));
  options.updates = 0;
  const TrainSummary stopped = RunAndStop(options, daemon.client());
  CHECK(stopped.state == RunState::kInterrupted);
  CHECK_FALSE(stopped.last);
  CHECK(stopped.use.simulator_steps == stopped.environment_steps);
}

}  // namespace
}  // namespace b4mrl
