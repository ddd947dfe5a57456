// A run's rows and evaluations: what stands in its logs, and what a checkpoint carries on.
#include "algorithms/run/run_log.h"

#include <catch2/catch.hpp>
#include <filesystem>
#include <string>

#include "algorithms/base/checkpoint.h"
#include "tests/algorithms/logged_rows.h"
#include "tests/algorithms/test_daemon.h"

namespace b4mrl {
namespace {

// A log in a new folder of the daemon's.
struct LoggedRun {
  explicit LoggedRun(TestDaemon& daemon) : client(daemon.client()) {
    options.environment = "HalfCheetah";
    options.eval_episodes = 2;
    options.folder = daemon.folder("run");
    std::filesystem::create_directories(options.folder);
  }
  RunLog Open() {
    static Progress quiet(true);
    return Take(RunLog::Open(options, client, quiet));
  }
  CheckpointWriter NewCheckpoint() const { return Take(CheckpointWriter::Create(checkpoint())); }
  std::string checkpoint() const { return CheckpointPath(options.folder, 10); }

  Client& client;
  TrainOptions options;
};

}  // namespace

TEST_CASE("A row is logged with its update's evaluation, which a checkpoint carries on") {
  TestDaemon daemon;
  LoggedRun run(daemon);
  RunLog log = run.Open();
  RequireOk(log.Begin());
  const EvaluationResult result = Take(log.Evaluate(TestDaemon::RandomAgent(), /*ledger=*/0));
  REQUIRE(result.returns.size() == 2);
  CHECK(log.evaluations().empty());  // until its row is written
  const RunUse use = {
      .simulator_steps = 1, .query_rows = 2, .dataset_rows = 3, .evaluation_episodes = 4};
  RequireOk(log.Write({{"update", 10}, {"loss", 1.0 / 3}}, result, use));
  RequireOk(log.Write({{"update", 20}, {"loss", 0.5}}));
  const auto rows = LoggedRows(run.options.folder);
  REQUIRE(rows.size() == 2);
  CHECK(rows[0]["evaluation_return"].get<double>() == Approx(result.mean_return));
  CHECK_FALSE(rows[1].contains("evaluation_return"));
  for (const RunUseEntry& entry : kRunUseEntries) {
    CHECK(rows[0][std::string(entry.name)] == use.*entry.value);
  }

  CheckpointWriter writer = run.NewCheckpoint();
  RequireOk(log.Save(writer));
  RequireOk(writer.Commit());
  RequireOk(log.Write({{"update", 30}}));  // what the resumed run cuts off
  RunLog resumed = run.Open();
  CheckpointReader reader = Take(CheckpointReader::Open(run.checkpoint()));
  RequireOk(resumed.Load(reader));
  REQUIRE(resumed.evaluations().size() == 1);
  CHECK(resumed.evaluations()[0].returns == result.returns);
  CHECK(LoggedRows(run.options.folder) == rows);
}

TEST_CASE("A checkpoint of an earlier version that awaits an evaluation is refused") {
  TestDaemon daemon;
  LoggedRun run(daemon);
  CheckpointWriter writer = run.NewCheckpoint();
  writer.Unsigned("run/held", 1);
  RequireOk(writer.Commit());
  CheckpointReader reader = Take(CheckpointReader::Open(run.checkpoint()));
  const Status status = run.Open().Load(reader);
  CHECK(status.code() == StatusCode::kDataLoss);
  CHECK(status.message().find("earlier version") != std::string::npos);
}

}  // namespace b4mrl
