// Datasets that are recorded here have equal bytes however the work is divided.
#include <algorithm>
#include <catch2/catch.hpp>
#include <iterator>
#include <span>
#include <vector>

#include "algorithms/episodes/replay.h"
#include "data/d4rl/dataset_file_reader.h"
#include "proto/base/rng.h"
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

TEST_CASE(
    "Of a log so many rows as asked for are recorded, from the newest start that leaves them") {
  constexpr uint64_t kRows = 400;
  TestDaemon daemon;
  ActionLog log;
  log.environment = "Hopper";  // whose episodes end after some twenty of these steps
  log.rows = kRows;
  log.action_size = 3;
  Rng rng(1, "recording-test");
  for (uint64_t i = 0; i < kRows * log.action_size; ++i) {
    log.actions.push_back(static_cast<float>(rng.Uniform(-1, 1)));
  }
  uint64_t first_episode = 0;
  const auto record = [&](uint64_t rows) {
    Recorder recorder = Take(Recorder::Create(
        daemon.folder("log.h5"), {.observation_dimensions = 11, .action_dimensions = 3}));
    Progress quiet(true);
    const auto first = ReplayActions(log, rows, daemon.client(), recorder, quiet);
    if (!first.ok()) return first.status();
    first_episode = *first;
    return recorder.writer().Commit(Existing::kReplace);
  };
  const auto block = [&](uint64_t rows) {
    const DatasetFileReader reader = Take(DatasetFileReader::Open(daemon.folder("log.h5")));
    REQUIRE(reader.rows() == rows);
    return Take(reader.Read(0, rows));
  };
  // The log names no hash of its rows yet; the refusal says what it is.
  const Status refused = record(kRows);
  REQUIRE(refused.code() == StatusCode::kDataLoss);
  const std::string& text = refused.message();
  log.replay_sha256 = text.substr(text.find("SHA-256 ") + 8, 64);
  RequireOk(record(kRows));
  CHECK(first_episode == 0);
  const DatasetBlock all = block(kRows);
  std::vector<uint64_t> starts = {0};
  for (uint64_t row = 0; row + 1 < kRows; ++row) {
    if (all.terminals[row] || all.timeouts[row]) starts.push_back(row + 1);
  }
  REQUIRE(starts.size() > 4);
  for (const uint64_t rows : {uint64_t{1}, uint64_t{100}, kRows - starts[2], kRows - 1}) {
    CAPTURE(rows);
    RequireOk(record(rows));
    const auto after = std::ranges::upper_bound(starts, kRows - rows);
    const uint64_t start = *std::prev(after);
    CHECK(first_episode == static_cast<uint64_t>(std::prev(after) - starts.begin()));
    const DatasetBlock some = block(rows);
    CHECK(std::ranges::equal(some.observations,
                             std::span(all.observations).subspan(start * 11, rows * 11)));
    CHECK(std::ranges::equal(some.actions, std::span(all.actions).subspan(start * 3, rows * 3)));
    CHECK(std::ranges::equal(some.rewards, std::span(all.rewards).subspan(start, rows)));
    CHECK(std::ranges::equal(some.terminals, std::span(all.terminals).subspan(start, rows)));
  }
  CHECK(record(kRows + 1).code() == StatusCode::kInvalidArgument);
}

}  // namespace b4mrl
