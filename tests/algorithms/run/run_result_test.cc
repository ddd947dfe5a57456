#include "algorithms/run/run_result.h"

#include <fcntl.h>
#include <sys/file.h>

#include <catch2/catch.hpp>
#include <future>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/data/temporary_folder.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

using Json = nlohmann::json;

// A run's folder with its result.
class RunFolder {
 public:
  RunFolder() { options_.folder = folder_.File(""); }

  const TrainOptions& options() const { return options_; }
  std::string path() const { return options_.folder; }
  Json Result() const { return Json::parse(ReadBytes(folder_.File("result.json"))); }
  void Write(const std::string& text) const { WriteBytes(folder_.File("result.json"), text); }

 private:
  TemporaryFolder folder_;
  TrainOptions options_;
};

TrainSummary Scored(RunState state) {
  TrainSummary summary;
  summary.state = state;
  summary.updates = 20;
  summary.last = EvaluationResult{.returns = {1, 3}, .lengths = {1, 1}, .mean_return = 2};
  return summary;
}

}  // namespace

TEST_CASE("A run that says it is running is killed when nobody holds its folder") {
  const RunFolder run;
  UniqueFd lock = Take(LockRunFolder(run.path()));
  RequireOk(WriteResult(run.options(), TrainSummary()));
  CHECK(Take(ReadRunStatus(run.path())).state == RunState::kRunning);
  lock.Reset();
  CHECK(Take(ReadRunStatus(run.path())).state == RunState::kKilled);
  RequireOk(WriteResult(run.options(), Scored(RunState::kFinished)));
  CHECK(Take(ReadRunStatus(run.path())).state == RunState::kFinished);
}

TEST_CASE("Another state keeps the scores that a run has") {
  const RunFolder run;
  RequireOk(WriteResultState(run.options(), RunState::kFailed, "no daemon"));
  CHECK(run.Result()["state"] == "failed");
  CHECK(run.Result()["updates"] == 0);
  RequireOk(WriteResult(run.options(), Scored(RunState::kInterrupted)));
  CHECK(run.Result()["interrupted"] == true);
  RequireOk(WriteResultState(run.options(), RunState::kRunning, ""));
  CHECK(run.Result()["interrupted"] == false);
  CHECK(run.Result()["returns"] == Json({1, 3}));
  RequireOk(WriteResultState(run.options(), RunState::kFailed, "no daemon"));
  const RunStatus status = Take(ReadRunStatus(run.path()));
  CHECK(status.state == RunState::kFailed);
  CHECK(status.reason == "no daemon");
  CHECK(status.updates == 20);
  CHECK(run.Result()["mean_return"] == 2);
}

TEST_CASE("A folder is one process's, and who only looks at it is not in the way") {
  const RunFolder run;
  const std::string path = run.path() + "/lock";
  UniqueFd reader(open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644));
  REQUIRE(flock(reader.get(), LOCK_SH) == 0);
  auto taken = std::async(std::launch::async, [&] { return LockRunFolder(run.path()); });
  reader.Reset();
  const Result<UniqueFd> lock = taken.get();
  RequireOk(lock.status());
  CHECK(LockRunFolder(run.path()).status().code() == StatusCode::kBusy);
}

TEST_CASE("A result that is none is refused, however deep it is, and written anew") {
  const RunFolder run;
  CHECK(ReadRunStatus(run.path()).status().code() == StatusCode::kIoError);
  const std::string deep = std::string(100'000, '[') + std::string(100'000, ']');
  for (const std::string& text :
       {std::string(), std::string("[]"), std::string("{}"), std::string(R"({"state":"running"})"),
        std::string(R"({"state":"asleep","reason":"","updates":1})"),
        std::string(R"({"state":"failed","reason":"","updates":-1})"),
        R"({"state":"failed","reason":"","updates":1,"returns":)" + deep + "}"}) {
    INFO(text.substr(0, 60));
    run.Write(text);
    CHECK(ReadRunStatus(run.path()).status().code() == StatusCode::kDataLoss);
    RequireOk(WriteResultState(run.options(), RunState::kFailed, "why"));
  }
}

}  // namespace b4mrl
