// Datasets that are recorded here have equal bytes however the work is divided.
#include <catch2/catch.hpp>

#include "algorithms/episodes/replay.h"
#include "tests/algorithms/test_daemon.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {

TEST_CASE("A recording has equal bytes for any number of lanes, workers and threads") {
  constexpr uint64_t kRows = 2500, kSeed = 3;
  TestDaemon small({"--workers", "1", "--threads", "1"});
  TestDaemon large({"--workers", "2", "--threads", "4"});
  const std::string bytes = ReadBytes(small.MakeDataset("one", kRows, kSeed, /*lanes_max=*/1));
  CHECK(ReadBytes(large.MakeDataset("many", kRows, kSeed, /*lanes_max=*/64)) == bytes);
  CHECK(ReadBytes(large.MakeDataset("other", kRows, kSeed + 1, /*lanes_max=*/64)) != bytes);
}

TEST_CASE("Fewer rows than a log's last episode has are refused with its length") {
  TestDaemon daemon;
  ActionLog log;
  log.environment = "HalfCheetah";
  log.rows = 1040;  // an episode of 1,000 steps and the beginning of another one
  log.action_size = 6;
  log.actions.resize(log.rows * log.action_size);
  const auto replay = [&](uint64_t rows) {
    Recorder recorder = Take(Recorder::Create(
        daemon.folder("x.h5"), {.observation_dimensions = 17, .action_dimensions = 6}));
    Progress quiet(true);
    return ReplayActions(log, rows, daemon.client(), recorder, quiet).status();
  };
  const Status refused = replay(39);
  CHECK(refused.code() == StatusCode::kInvalidArgument);
  CHECK_THAT(refused.message(), Catch::Contains("rows is 39, allowed: 40..1040"));
  CHECK(replay(40).code() == StatusCode::kDataLoss);  // the log names no hash of its rows
}

}  // namespace b4mrl
