// A diverged run is removed but for its claim, which a runner holds.
#include "benchmarks/runner/run_folder.h"

#include <catch2/catch.hpp>
#include <filesystem>

#include "benchmarks/jobs/job.h"
#include "tests/data/temporary_folder.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

TEST_CASE("A diverged run that is removed stays claimed") {
  const TemporaryFolder folder;
  const UniqueFd claim = Take(Claim(folder.File("claim")));
  for (const char* name : {"progress.csv", "run.json", "checkpoint-10.h5"}) {
    WriteBytes(folder.File(name), "");
  }
  fs::create_directories(folder.File("more/inside"));
  CHECK_FALSE(IsMarkedDiverged(folder.path()));
  RequireOk(MarkDiverged(folder.path(), {RunState::kDiverged, "a loss is \xff", 7}));
  CHECK(IsMarkedDiverged(folder.path()));
  {
    const UniqueFd training = Take(LockRunFolder(folder.path()));
    CHECK(RemoveDiverged(folder.path()).code() == StatusCode::kBusy);
    CHECK(fs::exists(folder.File("checkpoint-10.h5")));
  }
  RequireOk(RemoveDiverged(folder.path()));
  CHECK_FALSE(IsMarkedDiverged(folder.path()));
  const auto left = std::distance(fs::directory_iterator(folder.path()), fs::directory_iterator());
  CHECK(left == 2);  // with the lock of trainings
  CHECK_FALSE(Take(Claim(folder.File("claim"))).valid());
}

TEST_CASE("The agent of a finished run is kept when a longer one begins anew") {
  const TemporaryFolder folder;
  WriteBytes(folder.File("agent.h5"), "agent");
  for (const bool has_finished : {false, true}) {
    const std::string state = has_finished ? "finished" : "interrupted";
    WriteBytes(folder.File("result.json"),
               R"({"state": ")" + state + R"(", "reason": "", "updates": 40})");
    RemoveProgress(folder.path());
    CHECK_FALSE(fs::exists(folder.File("result.json")));
    CHECK(fs::exists(folder.File("agent-40.h5")) == has_finished);
    CHECK(fs::exists(folder.File("agent.h5")) != has_finished);
  }
}

TEST_CASE("What only a run that goes on needs is removed when it has ended") {
  const TemporaryFolder folder;
  for (const char* name : {"replay.bin", "ensemble.h5", "checkpoint-10.h5", "agent.h5"}) {
    WriteBytes(folder.File(name), "");
  }
  RemoveTraining(folder.path());
  CHECK(fs::exists(folder.File("agent.h5")));
  CHECK(std::distance(fs::directory_iterator(folder.path()), fs::directory_iterator()) == 1);
  RemoveTraining(folder.File("none"));  // does nothing
}

TEST_CASE("What a run needs that was stopped on its way is left there") {
  const TemporaryFolder folder;
  WriteBytes(folder.File("checkpoint-10.h5"), "");
  WriteBytes(folder.File("result.json"),
             R"({"state": "interrupted", "reason": "", "updates": 10})");
  RemoveTraining(folder.path());
  CHECK(fs::exists(folder.File("checkpoint-10.h5")));
  WriteBytes(folder.File("result.json"), R"({"state": "finished", "reason": "", "updates": 20})");
  RemoveTraining(folder.path());
  CHECK_FALSE(fs::exists(folder.File("checkpoint-10.h5")));
}

}  // namespace
}  // namespace b4mrl
