// A checkpoint that cannot be resumed for now, for which an older one must not take its place.
#include <atomic>
#include <catch2/catch.hpp>
#include <filesystem>
#include <string>
#include <vector>

#include "algorithms/base/checkpoint.h"
#include "algorithms/base/replay_file.h"
#include "algorithms/run/train_loop.h"
#include "tests/algorithms/run/small_run.h"
#include "tests/algorithms/test_daemon.h"
#include "tests/data/file_size_limit.h"

namespace b4mrl {

TEST_CASE("A checkpoint that a full disk keeps from being resumed stays the newest") {
  TestDaemon daemon;
  TrainOptions options = SmallRun("sac", daemon.folder("run"));
  RunTraining(options, daemon.client());
  const std::vector<uint64_t> before = Take(ListCheckpoints(options.folder));
  REQUIRE(before.size() == 2);
  CheckpointReader older = Take(CheckpointReader::Open(CheckpointPath(options.folder, before[1])));
  const uint64_t records = older.Unsigned("lanes/replay_length");
  RequireOk(older.status());
  options.resume = true;
  {
    // The replay grows from as many transitions as the checkpoint has: there is room for those of
    // the older one alone.
    constexpr uint64_t kGrowth = 65'536;
    const uint64_t begun = std::filesystem::file_size(options.folder + "/replay.bin");
    const FileSizeLimit full(begun + records * (begun - kReplayHeaderBytes) / kGrowth);
    const std::atomic<bool> stop = false;
    Progress quiet(true);
    const auto resumed = Train(options, daemon.client(), quiet, stop);
    CHECK(resumed.status().code() == StatusCode::kIoError);
  }
  CHECK(Take(ListCheckpoints(options.folder)) == before);
  CHECK(RunTraining(options, daemon.client()).updates == 60);
  CHECK_FALSE(std::filesystem::exists(options.folder + "/unreadable-checkpoint-60.h5"));
}

TEST_CASE("A checkpoint that cannot be opened for now stays the newest") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 500);
  TrainOptions options = SmallRun("bc", daemon.folder("run"));
  RunTraining(options, daemon.client());
  const std::vector<uint64_t> before = Take(ListCheckpoints(options.folder));
  const std::string newest = CheckpointPath(options.folder, before.at(0));
  options.resume = true;
  std::filesystem::rename(newest, newest + ".aside");
  std::filesystem::create_symlink(newest, newest);  // a loop, which nobody can open
  const std::atomic<bool> stop = false;
  Progress quiet(true);
  const auto resumed = Train(options, daemon.client(), quiet, stop);
  CHECK(resumed.status().code() == StatusCode::kIoError);
  std::filesystem::rename(newest + ".aside", newest);
  CHECK(RunTraining(options, daemon.client()).updates == 60);
  CHECK(Take(ListCheckpoints(options.folder)) == before);
}

}  // namespace b4mrl
