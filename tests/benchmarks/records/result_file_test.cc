// Results hold what training has left in its folder, however far it has come.
#include "benchmarks/records/result_file.h"

#include <catch2/catch.hpp>
#include <filesystem>

#include "tests/data/temporary_folder.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

const std::string kHeader =
    "train/n_updates,time/total_timesteps,time/time_elapsed,eval/mean_reward,eval/std_reward,eval/"
    "score,ledger/dataset_rows\n";

// A run's folder as `b4mrl train` writes it, and the folder of results.
class Folders {
 public:
  Folders() {
    fs::create_directories(run());
    fs::create_directories(results());
    WriteBytes(run() + "/run.json", R"({"hyperparameters": {"gamma": 0.99}, "processor": "Z80", )"
                                    R"("sessions": [{"version": "1"}]})");
    State("running");
    planned_.name = "HalfCheetah-iql-medium-s0";
    planned_.id = "0123456789abcdef";
    planned_.cell_id = "fedcba9876543210";
    planned_.algorithm = "iql";
    planned_.updates = 500;
    planned_.all_benchmarks = {"HalfCheetah/clean/medium"};
  }
  std::string run() const { return folder_.File("run"); }
  std::string results() const { return folder_.File("results"); }
  std::string path() const { return ResultPath(results(), planned_); }
  void State(const std::string& state, const std::string& rows_sha256 = "") {
    WriteBytes(run() + "/result.json",
               R"({"state": ")" + state + R"(", "updates": 500, "evaluation_updates": 500, )" +
                   R"("returns": [1, 2], "dataset_columns_sha256": ")" + rows_sha256 + R"("})");
  }
  // What the runner keeps of a learner of the user's own that was asked for so many updates and
  // stopped after seven.
  void Learned(uint64_t planned_updates) {
    planned_.learner = "python mine.py";
    WriteBytes(run() + "/learned.json",
               R"({"source": "self-scored", "returns": [1, 2], "mean_return": 1.5, )"
               R"("std_return": 0.5, "updates": 7, "planned_updates": )" +
                   std::to_string(planned_updates) + "}");
  }
  void AskFor(uint64_t updates) { planned_.updates = updates; }
  // Names the benchmarks of a plan whose run fills these cells.
  Status Name(const std::vector<std::string>& benchmarks) {
    planned_.all_benchmarks = benchmarks;
    return NameAllBenchmarks(planned_, results());
  }
  void Progress(const std::string& rows) { WriteBytes(run() + "/progress.csv", kHeader + rows); }
  Status Write(const std::optional<UsedDataset>& dataset = {}) {
    return WriteResultOf(planned_, run(), dataset, {"small", "0a1b2c", planned_.updates}, results())
        .status();
  }
  nlohmann::json Written() const {
    return nlohmann::json::parse(ReadBytes(path()), nullptr, false);
  }

 private:
  TemporaryFolder folder_;
  PlannedRun planned_;
};

TEST_CASE("A run without an evaluation has no result") {
  Folders folders;
  folders.Progress("100,0,1,,,\n");
  RequireOk(folders.Write());
  CHECK_FALSE(fs::exists(folders.path()));
  CHECK_FALSE(Take(ReadResult(folders.path())).has_value());
}

TEST_CASE("A run that is cut off has the result of its last evaluation") {
  Folders folders;
  // The last line is still being written.
  folders.Progress("100,5,1,10,1,20\n150,5,2,,,\n200,7,3,12,1,22.5,77\n300,9,4,99,1,9");
  RequireOk(folders.Write(UsedDataset{"HalfCheetah/medium-v0", 10, "aa", "bb"}));
  const auto json = folders.Written();
  CHECK(json["curve"] == nlohmann::json::parse("[[100,5,10.0,1.0,20.0],[200,7,12.0,1.0,22.5]]"));
  CHECK(json["updates"] == 200);
  CHECK(json["planned_updates"] == 500);
  CHECK(json["finished"] == false);
  CHECK(json["score"] == 22.5);
  CHECK(json["dataset"]["columns_sha256"] == "bb");
  CHECK(json["hyperparameters"]["gamma"] == 0.99);
  CHECK(json["processor"] == "Z80");
  CHECK(json["ledger"]["dataset_rows"] == 77);
  CHECK(json["ledger"]["query_rows"].is_null());  // which this run's log has no column for
  CHECK(json["returns"].empty());                 // those in the folder are of another update
  CHECK(json["commit"] == "0a1b2c");
  const RunResult read = *Take(ReadResult(folders.path()));
  CHECK(read.updates == 200);
  CHECK_FALSE(read.finished);
  CHECK(read.score == 22.5);
  CHECK(read.seconds == 3);
}

TEST_CASE("A run is settled if its last two fifths agree") {
  const auto settled = [](double before, double after) {
    Folders folders;
    folders.State("finished");
    std::string rows;
    for (int update = 100; update <= 500; update += 100) {
      const double score = update == 500 ? after : before;
      rows += std::to_string(update) + ",0,1,10,1," + std::to_string(score) + "\n";
    }
    folders.Progress(rows);
    RequireOk(folders.Write());
    CHECK(folders.Written()["finished"] == true);
    CHECK(Take(ReadResult(folders.path()))->settled == folders.Written()["settled"].get<bool>());
    CHECK(folders.Written()["last_fifth"] == Approx(after));
    CHECK(folders.Written()["fifth_before"] == Approx(before));
    return folders.Written()["settled"].get<bool>();
  };
  CHECK(settled(40, 41.5));
  CHECK_FALSE(settled(40, 41.6));
  CHECK_FALSE(settled(40, 38));
}

TEST_CASE("A run whose policy learns no more has settled, however far the score has moved") {
  const auto settled = [](const std::string& learns_until) {
    Folders folders;
    folders.State("finished");
    WriteBytes(folders.run() + "/run.json",
               R"({"hyperparameters": {"cosine-updates": )" + learns_until + "}}");
    folders.Progress("100,0,1,10,1,10\n400,0,1,10,1,40\n500,0,1,10,1,50\n");
    RequireOk(folders.Write());
    return folders.Written()["settled"].get<bool>();
  };
  CHECK(settled("500"));
  CHECK_FALSE(settled("501"));
  CHECK_FALSE(settled("0"));  // a constant learning rate
  CHECK_FALSE(settled("1e300"));
}

TEST_CASE("A result takes no rows for those that the run learned from which are others now") {
  Folders folders;
  folders.State("running", "bb");
  folders.Progress("100,5,1,10,1,20\n");
  RequireOk(folders.Write(UsedDataset{"HalfCheetah/medium-v0", 10, "aa", "bb"}));
  folders.Progress("100,5,1,10,1,20\n200,7,3,12,1,22.5\n");
  const Status refused = folders.Write(UsedDataset{"HalfCheetah/medium-v0", 10, "aa", "cc"});
  CHECK(refused.code() == StatusCode::kFailedPrecondition);
  CHECK(refused.message().find("HalfCheetah/medium-v0 has other rows now") == 0);
  CHECK(folders.Written()["updates"] == 100);
}

TEST_CASE("A further scoring of a finished run leaves what it learned from as it was") {
  Folders folders;
  folders.State("finished");
  folders.Progress("500,5,1,10,1,20\n");
  RequireOk(folders.Write(UsedDataset{"HalfCheetah/medium-v0", 10, "aa", "bb"}));
  RequireOk(folders.Write(UsedDataset{"HalfCheetah/medium-v0", 10, "dd", "bb"}));
  CHECK(folders.Written()["dataset"]["sha256"] == "aa");
}

TEST_CASE("A learner that brings the same numbers again has a result of what it was then told") {
  Folders folders;
  folders.Learned(100);
  RequireOk(folders.Write(UsedDataset{"HalfCheetah/medium-v0", 10, "aa", "bb"}));
  folders.Learned(200);
  RequireOk(folders.Write(UsedDataset{"HalfCheetah/medium-v0", 10, "aa", "bb"}));
  CHECK(folders.Written()["planned_updates"] == 200);
  RequireOk(folders.Write(UsedDataset{"HalfCheetah/medium-v0", 10, "cc", "dd"}));
  CHECK(folders.Written()["dataset"]["columns_sha256"] == "dd");
}

TEST_CASE(
    "The result of a run that diverged says why, and has the returns of its last evaluation") {
  Folders folders;
  folders.Progress("100,5,1,10,1,20\n");
  WriteBytes(folders.run() + "/result.json",
             R"({"state": "diverged", "reason": "loss became nan; see /a/checkpoint-90", )"
             R"("updates": 120, "evaluation_updates": 100, "returns": [9, 11]})");
  RequireOk(folders.Write());
  const auto json = nlohmann::ordered_json(folders.Written());
  CHECK(json["diverged"] == "loss became nan");
  CHECK(json["finished"] == false);
  CHECK(json["returns"].size() == 2);
  CHECK(HasDiverged(json));
  folders.State("finished");
  folders.Progress("100,5,1,10,1,20\n500,7,3,12,1,22\n");
  RequireOk(folders.Write());
  CHECK_FALSE(folders.Written().contains("diverged"));
}

TEST_CASE("A reason of divergence is no longer than it may be, and a finished run has none") {
  nlohmann::ordered_json json = {{"finished", false}, {"diverged", std::string(1'000, 'x')}};
  CHECK(HasDiverged(json));
  json["diverged"] = std::string(1'001, 'x');
  CHECK_FALSE(HasDiverged(json));
  json["diverged"] = "x";
  json["finished"] = true;
  CHECK_FALSE(HasDiverged(json));
}

TEST_CASE("A result keeps the benchmarks that a plan with more suites has named") {
  Folders folders;
  folders.Progress("100,5,1,10,1,20\n");
  RequireOk(folders.Write());
  RequireOk(folders.Name({"HalfCheetah/mine/medium"}));
  folders.Progress("100,5,1,10,1,20\n200,7,3,12,1,22.5\n");
  RequireOk(folders.Write());
  CHECK(folders.Written()["updates"] == 200);
  CHECK(folders.Written()["benchmarks"].size() == 2);
}

TEST_CASE("A run that was begun anew replaces its result once it has come as far") {
  Folders folders;
  folders.Progress("100,5,1,10,1,20\n200,7,3,12,1,22.5\n");
  RequireOk(folders.Write());
  folders.Progress("100,5,1,10,1,30\n");
  RequireOk(folders.Write());
  CHECK(folders.Written()["score"] == 22.5);
  folders.Progress("100,5,1,10,1,30\n200,7,3,12,1,32.5\n");
  RequireOk(folders.Write());
  CHECK(folders.Written()["score"] == 32.5);
}

TEST_CASE("A finished result stays until its run has finished with more updates") {
  Folders folders;
  folders.State("finished");
  folders.Progress("500,5,1,10,1,20\n");
  RequireOk(folders.Write());
  const nlohmann::json finished = folders.Written();
  CHECK(finished["finished"] == true);
  folders.AskFor(900);
  folders.State("interrupted");
  folders.Progress("500,5,1,10,1,20\n700,7,2,11,1,21\n");
  RequireOk(folders.Write());
  CHECK(folders.Written() == finished);
  CHECK(Take(EvaluatedUpdates(folders.run())) == 700);
  folders.State("finished");
  folders.Progress("500,5,1,10,1,20\n900,9,3,12,1,22\n");
  RequireOk(folders.Write());
  CHECK(folders.Written()["updates"] == 900);
}

TEST_CASE("The result of a run that was cut off gives way to a finished one of fewer updates") {
  Folders folders;
  folders.AskFor(900);
  folders.Progress("700,7,2,11,1,21\n");
  RequireOk(folders.Write());
  folders.AskFor(500);
  folders.State("finished");
  folders.Progress("500,5,1,10,1,20\n");
  RequireOk(folders.Write());
  CHECK(folders.Written()["updates"] == 500);
  CHECK(folders.Written()["finished"] == true);
}

TEST_CASE("Tasks without reference returns have no score") {
  Folders folders;
  folders.Progress("100,5,1,10,1,\n");
  RequireOk(folders.Write());
  CHECK(folders.Written()["score"].is_null());
  CHECK(folders.Written()["return"] == 10);
  CHECK_FALSE(Take(ReadResult(folders.path()))->score.has_value());
}

TEST_CASE("A result names the benchmarks of suites that have grown, and keeps those it had") {
  Folders folders;
  folders.Progress("100,5,0.125,10,1,20.1\n");
  RequireOk(folders.Write());
  const std::string before = ReadBytes(folders.path());
  RequireOk(folders.Name({"HalfCheetah/clean/medium"}));
  CHECK(ReadBytes(folders.path()) == before);
  RequireOk(folders.Name({"HalfCheetah/mine/medium", "HalfCheetah/clean/medium"}));
  auto json = folders.Written();
  CHECK(json["benchmarks"] ==
        std::vector<std::string>{"HalfCheetah/clean/medium", "HalfCheetah/mine/medium"});
  json.erase("benchmarks");
  auto rest = nlohmann::json::parse(before);
  rest.erase("benchmarks");
  CHECK(json == rest);
  RequireOk(folders.Name({"HalfCheetah/clean/medium"}));
  CHECK(folders.Written()["benchmarks"].size() == 2);
}

TEST_CASE("What is no result is refused by name") {
  Folders folders;
  WriteBytes(folders.path(), "[1]");
  CHECK(ReadResult(folders.path()).status().code() == StatusCode::kDataLoss);
  WriteBytes(folders.path(), R"({"updates": "many", "finished": 3})");
  const RunResult read = *Take(ReadResult(folders.path()));
  CHECK(read.updates == 0);
  CHECK_FALSE(read.finished);
}

TEST_CASE("Lines of a log that are no evaluation are passed over") {
  Folders folders;
  folders.Progress(
      "100,0,1,5,0,50,-3\n"
      "-7,0,1,5,0,50,3\n"
      "nan,0,1,5,0,50,3\n"
      "1e300,0,1,5,0,50,3\n"
      "300,1e300,1,nan,0,50,3\n"
      "many,words\n");
  RequireOk(folders.Write());
  const auto json = folders.Written();
  CHECK(json["curve"].size() == 1);
  CHECK(json["updates"] == 100);
  CHECK(json["ledger"]["dataset_rows"].is_null());
}

TEST_CASE("A run is done when it has finished with the updates that it is to do, or with more") {
  const PlannedRun run;
  CHECK(RunResult{.finished = true, .updates = 100}.IsDone(run, 100));
  CHECK_FALSE(RunResult{.finished = false, .updates = 100}.IsDone(run, 100));
  CHECK(RunResult{.finished = true, .updates = 101}.IsDone(run, 100));
  CHECK_FALSE(RunResult{.finished = false, .updates = 101}.IsDone(run, 100));
  CHECK_FALSE(RunResult{.finished = true, .updates = 99}.IsDone(run, 100));
}

TEST_CASE("A run of a user's learner that was asked for as much is done when the learner says so") {
  PlannedRun run;
  run.learner = "python my.py";
  CHECK(RunResult{.finished = true, .updates = 7, .planned_updates = 100}.IsDone(run, 100));
  CHECK_FALSE(RunResult{.finished = true, .updates = 100, .planned_updates = 99}.IsDone(run, 100));
  CHECK_FALSE(
      RunResult{.finished = false, .updates = 200, .planned_updates = 200}.IsDone(run, 100));
}

TEST_CASE("A run of a user's learner from other rows than those at hand is not done") {
  const RunResult result = {
      .finished = true, .updates = 100, .planned_updates = 100, .columns_sha256 = "aa"};
  PlannedRun run;
  run.rows_at_hand = "bb";
  CHECK(result.IsOfOtherRows(run));
  CHECK(result.IsDone(run, 100));  // of the project's, which is only told
  run.learner = "python my.py";
  CHECK_FALSE(result.IsDone(run, 100));
  run.rows_at_hand = "aa";
  CHECK(result.IsDone(run, 100));
  run.rows_at_hand = "";  // nobody has counted them
  CHECK(result.IsDone(run, 100));
}

TEST_CASE("A copy of results inside a folder of results hides none of these") {
  const TemporaryFolder folder;
  const std::string inside = folder.File("results");
  CHECK(FolderOfResults(folder.path()) == folder.path());
  fs::create_directories(inside);
  WriteBytes(folder.File("plan.json"), R"({"runs": ["0123456789abcdef"]})");
  CHECK(FolderOfResults(folder.path()) == inside);
  WriteBytes(folder.File("one.json"), R"({"benchmarks": ["E/a"], "curve": []})");
  CHECK(FolderOfResults(folder.path()) == folder.path());
}

}  // namespace
}  // namespace b4mrl
