// A run that was killed and resumed must end with the bits of one that was not.
#include <atomic>
#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <sstream>

#include "algorithms/base/checkpoint.h"
#include "algorithms/list.h"
#include "algorithms/run/train_loop.h"
#include "data/d4rl/agent_file.h"
#include "tests/algorithms/logged_rows.h"
#include "tests/algorithms/run/small_run.h"
#include "tests/algorithms/test_daemon.h"

namespace b4mrl {
namespace {

// Equal agents give equal bytes: all tensors of the policy, and where it comes from.
void RequireEqualAgents(const std::string& path_a, const std::string& path_b) {
  REQUIRE(Take(ReadAgent(path_a)).hidden.size() == 2);
  const bool equal = ReadBytes(path_a) == ReadBytes(path_b);
  CHECK(equal);
}

// Each row's rate is that of the updates since the row before, whatever happened in between.
void RequireTrueRates(const std::string& folder) {
  const std::vector<nlohmann::json> rows = LoggedRows(folder);
  for (size_t i = 1; i < rows.size(); ++i) {
    const auto change = [&](const char* name) {
      return rows[i][name].get<double>() - rows[i - 1][name].get<double>();
    };
    INFO(rows[i].dump());
    // The logs keep nine digits of a few seconds, and a row takes milliseconds.
    CHECK(rows[i]["updates_per_second"].get<double>() ==
          Approx(change("update") / change("seconds")).epsilon(1e-3));
  }
}

// What a killed process may leave behind its last checkpoint.
void AppendGarbage(const std::string& path) {
  std::ofstream(path, std::ios::binary | std::ios::app) << "half a li";
}

std::vector<std::string> Cells(const std::string& line) {
  std::vector<std::string> cells;
  std::istringstream stream(line);
  for (std::string cell; std::getline(stream, cell, ',');) cells.push_back(cell);
  return cells;
}

// A CSV file's cells, but for the columns that depend on timing (logged_rows.h).
std::vector<std::string> TimelessCells(const std::string& path) {
  std::istringstream lines(ReadBytes(path));
  std::string line;
  std::getline(lines, line);
  const std::vector<std::string> names = Cells(line);
  std::vector<std::string> kept;
  while (std::getline(lines, line)) {
    const std::vector<std::string> cells = Cells(line);
    for (size_t i = 0; i < cells.size(); ++i) {
      const std::string& name = names.at(i);
      if (name == "time/time_elapsed" || name == "time/updates_per_second") continue;
      if (name == "ledger/dataset_rows" || name == "ledger/query_rows") continue;
      kept.push_back(cells[i]);
    }
  }
  return kept;
}

// The rows as two runs must agree on them. A rollout that lags behind is simulated while the run
// goes on, so the queries that the daemon has answered by then depend on timing.
std::vector<nlohmann::json> ComparedRows(const TrainOptions& options) {
  std::vector<nlohmann::json> rows = RowsWithoutTimes(options.folder);
  if (options.hyperparameters.NumberOr("rollout-lag", 0) == 0) return rows;
  for (nlohmann::json& row : rows) row.erase("query_rows");
  return rows;
}

void CheckResume(TestDaemon& daemon, const TrainOptions& options, uint64_t first = 30) {
  TrainOptions straight = options;
  straight.folder = daemon.folder("straight");
  if (!straight.dataset.empty()) daemon.MakeDataset("small", 500);
  const TrainSummary expected = RunTraining(straight, daemon.client());

  TrainOptions halves = straight;
  halves.folder = daemon.folder("halves");
  halves.updates = first;
  CHECK(RunTraining(halves, daemon.client()).state == RunState::kFinished);
  AppendGarbage(halves.folder + "/progress.csv");
  AppendGarbage(halves.folder + "/metrics.jsonl");
  AppendGarbage(halves.folder + "/events.out.tfevents.b4mrl");
  halves.updates = 60;
  halves.resume = true;
  const TrainSummary resumed = RunTraining(halves, daemon.client());

  RequireEqualAgents(straight.folder + "/agent.h5", halves.folder + "/agent.h5");
  CHECK(resumed.last->returns == expected.last->returns);
  CHECK(resumed.environment_steps == expected.environment_steps);
  CHECK(resumed.mean_return_of_last_ten == expected.mean_return_of_last_ten);
  CHECK(TimelessCells(halves.folder + "/progress.csv") ==
        TimelessCells(straight.folder + "/progress.csv"));
  CHECK(ComparedRows(halves) == ComparedRows(straight));
  CHECK(std::filesystem::file_size(halves.folder + "/events.out.tfevents.b4mrl") ==
        std::filesystem::file_size(straight.folder + "/events.out.tfevents.b4mrl"));
  CHECK(Take(ListCheckpoints(halves.folder)) == std::vector<uint64_t>{60, first});
  RequireTrueRates(halves.folder);
}

}  // namespace

TEST_CASE("A resumed run of every learner ends with the bits of an undisturbed one") {
  for (const Algorithm& algorithm : Algorithms()) {
    DYNAMIC_SECTION(algorithm.name) {
      TestDaemon daemon;
      CheckResume(daemon, SmallRun(algorithm.name, ""));
    }
  }
}

TEST_CASE("A resumed run whose rollouts lag behind ends with the bits of an undisturbed one") {
  for (const Algorithm& algorithm : Algorithms()) {
    TrainOptions options = SmallRun(algorithm.name, "");
    if (options.hyperparameters.Find("rollout-lag") == nullptr) continue;
    DYNAMIC_SECTION(algorithm.name) {
      RequireOk(options.hyperparameters.Set("rollout-lag", 1));
      TestDaemon daemon;
      CheckResume(daemon, options);
    }
  }
}

TEST_CASE(
    "A run that ended where a longer one evaluates or logs nothing is continued as that one") {
  TestDaemon no_row, no_evaluation;
  CheckResume(no_row, SmallRun("td3-bc", ""), /*first=*/45);         // nor an evaluation
  CheckResume(no_evaluation, SmallRun("td3-bc", ""), /*first=*/40);  // but a row
}

TEST_CASE("The last update is evaluated and logged, however the run is cut up") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 500);
  TrainOptions options = SmallRun("td3-bc", daemon.folder("run"));
  options.updates = 45;
  const TrainSummary first = RunTraining(options, daemon.client());
  REQUIRE(first.last.has_value());
  const auto rows = RowsWithoutTimes(options.folder);
  REQUIRE(rows.size() == 5);
  CHECK(rows.back()["update"] == 45);
  CHECK(rows.back().contains("evaluation_return"));
  CHECK(rows.back().contains("critic_loss"));
  const std::string agent = ReadBytes(first.agent_path);
  options.resume = true;  // there is nothing left to do
  const TrainSummary again = RunTraining(options, daemon.client());
  CHECK(again.last->returns == first.last->returns);
  CHECK(again.mean_return_of_last_ten == first.mean_return_of_last_ten);
  CHECK(RowsWithoutTimes(options.folder) == rows);
  CHECK((ReadBytes(again.agent_path) == agent));
}

TEST_CASE("The seconds in a log include the preparation") {
  TestDaemon daemon;
  TrainOptions options = SmallRun("sac", daemon.folder("run"));
  RequireOk(options.hyperparameters.Set("warm-up", 2000));  // takes longer than ten updates
  options.updates = 30;
  RunTraining(options, daemon.client());
  const double prepared =
      Take(CheckpointReader::Open(CheckpointPath(options.folder, 0))).Number("run/seconds");
  std::ifstream lines(options.folder + "/metrics.jsonl");
  std::string line;
  REQUIRE(std::getline(lines, line));
  const auto row = nlohmann::json::parse(line, nullptr, /*allow_exceptions=*/false);
  CHECK(prepared > 0);
  CHECK(row["seconds"] > prepared);
}

TEST_CASE("Another seed gives other weights") {
  TestDaemon daemon;
  TrainOptions a = SmallRun("sac", daemon.folder("a"));
  TrainOptions b = SmallRun("sac", daemon.folder("b"));
  b.seed = 4;
  RunTraining(a, daemon.client());
  RunTraining(b, daemon.client());
  CHECK(Take(ReadAgent(a.folder + "/agent.h5")).last_fc.weight !=
        Take(ReadAgent(b.folder + "/agent.h5")).last_fc.weight);
}

TEST_CASE("A damaged newest checkpoint falls back to the one before it") {
  TestDaemon daemon;
  TrainOptions options = SmallRun("sac", daemon.folder("run"));
  RunTraining(options, daemon.client());
  const std::vector<uint64_t> before = Take(ListCheckpoints(options.folder));
  REQUIRE(before.size() == 2);
  const auto rows = TimelessCells(options.folder + "/progress.csv");
  std::filesystem::copy(options.folder + "/agent.h5", daemon.folder("straight.h5"));
  const std::string newest = CheckpointPath(options.folder, 60);
  const std::string damaged = ReadBytes(newest).substr(0, 1000);
  WriteBytes(newest, damaged);
  options.resume = true;
  const TrainSummary resumed = RunTraining(options, daemon.client());
  CHECK(resumed.updates == 60);
  CHECK(Take(CheckpointReader::Open(newest)).Unsigned("run/update") == 60);
  RequireEqualAgents(daemon.folder("straight.h5"), options.folder + "/agent.h5");
  CHECK(TimelessCells(options.folder + "/progress.csv") == rows);
  // A run from the beginning would have kept other checkpoints.
  CHECK(Take(ListCheckpoints(options.folder)) == before);
  CHECK(ReadBytes(options.folder + "/unreadable-checkpoint-60.h5") == damaged);
}

TEST_CASE("A newest checkpoint that lacks a log's length or is another update's is passed over") {
  const bool is_older = GENERATE(false, true);
  TestDaemon daemon;
  daemon.MakeDataset("small", 500);
  TrainOptions options = SmallRun("td3-bc", daemon.folder("run"));
  RunTraining(options, daemon.client());
  std::filesystem::copy(options.folder + "/agent.h5", daemon.folder("straight.h5"));
  std::string damaged = ReadBytes(CheckpointPath(options.folder, is_older ? 30 : 60));
  if (!is_older) {
    const size_t name = damaged.find("json_bytes");
    REQUIRE(name != std::string::npos);
    damaged[name + 3] = 'o';  // the entry has another name then
  }
  WriteBytes(CheckpointPath(options.folder, 60), damaged);
  options.resume = true;
  CHECK(RunTraining(options, daemon.client()).updates == 60);
  CHECK((ReadBytes(options.folder + "/unreadable-checkpoint-60.h5") == damaged));
  CHECK(Take(ListCheckpoints(options.folder)) == std::vector<uint64_t>{60, 30});
  RequireEqualAgents(daemon.folder("straight.h5"), options.folder + "/agent.h5");
}

TEST_CASE("A run whose loss is not finite stops and names the loss and the last good state") {
  TestDaemon daemon;
  daemon.MakeDataset("source", 100);
  {
    DatasetOptions stored;
    RemoteDataset source = Take(daemon.client().OpenDataset("HalfCheetah/source", stored));
    const TransitionRows rows = Take(source.Read(0, 100));
    DatasetWriterOptions options;
    options.observation_dimensions = 17;
    options.action_dimensions = 6;
    DatasetWriter writer =
        Take(DatasetWriter::Create(daemon.folder("data/HalfCheetah/small.h5"), options));
    // Finite, as a dataset has to be, but no float holds their sum.
    const std::vector<float> observations(100 * 17, std::numeric_limits<float>::max());
    const std::vector<uint8_t> no_timeouts(100, 0);
    DatasetRows out;
    out.rows = 100;
    out.observations = observations;
    out.actions = rows.actions;
    out.next_observations = rows.next_observations;
    out.rewards = rows.rewards;
    out.terminals = rows.terminals;
    out.timeouts = no_timeouts;
    RequireOk(writer.Append(out));
    RequireOk(writer.Commit());
  }
  TrainOptions options = SmallRun("td3-bc", daemon.folder("run"));
  RequireOk(options.hyperparameters.Set("normalise", 0));
  const std::atomic<bool> stop = false;
  Progress quiet(true);
  const Status status = Train(options, daemon.client(), quiet, stop).status();
  CHECK(status.code() == StatusCode::kFailedPrecondition);
  // A processor makes a NaN with a sign of its own.
  CHECK_THAT(status.message(), Catch::Matches(".*critic_loss became -?(nan|inf) at update 1;.*"));
  CHECK(status.message().find(CheckpointPath(options.folder, 0)) != std::string::npos);
  RequireOk(CheckpointReader::Open(CheckpointPath(options.folder, 0)).status());
  const RunStatus left = Take(ReadRunStatus(options.folder));
  CHECK(left.state == RunState::kDiverged);
  CHECK(left.reason == status.ToString());
}

TEST_CASE("A run that diverges keeps a checkpoint whose numbers are all finite") {
  TestDaemon daemon;
  TrainOptions options = SmallRun("sac", daemon.folder("run"));
  options.updates = options.eval_every = 2000;  // it diverges within a hundred
  options.checkpoint_every = 5;
  // Nothing restrains the values: full bootstrapping from targets that follow at once.
  for (const char* name : {"learning-rate", "gamma", "tau"}) {
    RequireOk(options.hyperparameters.Set(name, 1));
  }
  const std::atomic<bool> stop = false;
  Progress quiet(true);
  const Status status = Train(options, daemon.client(), quiet, stop).status();
  INFO(status.ToString());
  REQUIRE(status.code() == StatusCode::kFailedPrecondition);
  CHECK(status.message().find("the run diverged") != std::string::npos);
  const uint64_t newest = Take(ListCheckpoints(options.folder)).front();
  CHECK(newest > 0);
  CHECK(status.message().find(CheckpointPath(options.folder, newest)) != std::string::npos);

  // Another update from there is possible, and evaluates.
  options.resume = true;
  options.updates = newest + 1;
  CHECK(RunTraining(options, daemon.client()).updates == newest + 1);
}

TEST_CASE("A run refuses a folder that holds another one") {
  TestDaemon daemon;
  const TrainOptions options = SmallRun("sac", daemon.folder("run"));
  RunTraining(options, daemon.client());
  const std::atomic<bool> stop = false;
  Progress quiet(true);
  CHECK(Train(options, daemon.client(), quiet, stop).status().code() ==
        StatusCode::kFailedPrecondition);
}

TEST_CASE("A run that is told to stop leaves a checkpoint to resume from") {
  TestDaemon daemon;
  TrainOptions options = SmallRun("sac", daemon.folder("run"));
  const std::atomic<bool> stop = true;
  Progress quiet(true);
  const TrainSummary stopped = Take(Train(options, daemon.client(), quiet, stop));
  CHECK(stopped.state == RunState::kInterrupted);
  CHECK(stopped.updates == 0);
  CHECK(Take(ReadRunStatus(options.folder)).state == RunState::kInterrupted);
  options.resume = true;
  CHECK(RunTraining(options, daemon.client()).updates == 60);
}

TEST_CASE("Threads change no bit of what any learner learns, in fp32 and in bf16") {
  for (const Algorithm& algorithm : Algorithms()) {
    DYNAMIC_SECTION(algorithm.name) {
      TestDaemon daemon;
      TrainOptions alone = SmallRun(algorithm.name, daemon.folder("alone"));
      if (!alone.dataset.empty()) daemon.MakeDataset("small", 500);
      alone.precision = GENERATE(Precision::kFp32, Precision::kBf16);
      if (!CheckPrecision(alone.precision).ok()) {
        WARN("skipped: this processor has no AVX512-BF16");
        continue;
      }
      TrainOptions team = alone;
      team.folder = daemon.folder("team");
      team.threads = 3;
      RequireEqualAgents(RunTraining(alone, daemon.client()).agent_path,
                         RunTraining(team, daemon.client()).agent_path);
    }
  }
}

TEST_CASE("A run ends at the first evaluation that reaches the score asked for") {
  TestDaemon daemon;
  TrainOptions options = SmallRun("sac", daemon.folder("run"));
  options.stop_at_score = -1000;  // any policy has more
  const TrainSummary summary = RunTraining(options, daemon.client());
  CHECK(summary.updates == options.eval_every);
  CHECK(summary.state == RunState::kFinished);
  CHECK(summary.reason.find("-1000") != std::string::npos);
}

TEST_CASE("A score asked for on resuming ends no run at an update that nobody evaluated") {
  TestDaemon daemon;
  TrainOptions options = SmallRun("sac", daemon.folder("run"));
  options.updates = 45;
  RunTraining(options, daemon.client());  // its checkpoint has the evaluation at 30 alone
  options.updates = 75;
  options.resume = true;
  options.stop_at_score = -1000;
  const TrainSummary summary = RunTraining(options, daemon.client());
  CHECK(summary.updates == 60);
  CHECK(summary.last_updates == 60);
}

}  // namespace b4mrl
