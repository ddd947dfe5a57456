#include "algorithms/run/run_record.h"

#include <catch2/catch.hpp>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "algorithms/base/hyperparameters.h"
#include "data/files/atomic_file.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

using Json = nlohmann::json;

// A run's folder whose record the test may change.
class Recorded {
 public:
  Recorded() {
    TrainOptions options;
    options.algorithm = "sac";
    options.environment = "HalfCheetah";
    options.seed = UINT64_MAX;
    options.precision = Precision::kBf16;
    options.folder = folder_.File("");
    REQUIRE(WriteRunRecord(options).ok());
    const auto text = ReadSmallFile(folder_.File("run.json"), 1 << 20);
    REQUIRE(text.ok());
    json_ = Json::parse(*text);
  }

  Result<RunRecord> Read() const { return ReadRunRecord(folder_.File("")); }
  Result<RunRecord> ReadWith(const std::string& name, const Json& value) const {
    Json changed = json_;
    changed[name] = value;
    return ReadText(changed.dump());
  }
  Result<RunRecord> ReadText(const std::string& text) const {
    REQUIRE(WriteSmallFile(folder_.File("run.json"), text).ok());
    return Read();
  }

 private:
  TemporaryFolder folder_;
  Json json_;
};

}  // namespace

TEST_CASE("A training from its first update replaces nothing that somebody wants to keep") {
  const TemporaryFolder folder;
  TrainOptions options;
  options.algorithm = "mopo";
  options.environment = "HalfCheetah";
  options.folder = folder.path();
  REQUIRE(CheckEarlierRun(options).ok());
  const auto refusal = [&] {
    const Status status = CheckEarlierRun(options);
    return status.code() == StatusCode::kFailedPrecondition ? status.message() : "";
  };
  // Files of the user's own.
  for (const char* name : {"agent.h5", "config.toml", "progress.csv"}) {
    WriteBytes(folder.File(name), "mine");
    CHECK_THAT(refusal(), Catch::Contains(name));
    std::filesystem::remove(folder.File(name));
  }
  // A run that has not come to a checkpoint begins anew, but for the model of another one.
  REQUIRE(WriteRunRecord(options).ok());
  for (const char* name : {"metrics.jsonl", "ensemble.h5"}) WriteBytes(folder.File(name), "");
  CHECK(CheckEarlierRun(options).ok());
  options.seed = 9;
  CHECK_THAT(refusal(), Catch::Contains("the model of a run with other options"));
  options.seed = 0;
  for (const bool resume : {false, true}) {
    options.resume = resume;
    WriteBytes(folder.File("result.json"), R"({"state": "killed", "reason": "", "updates": 9})");
    CHECK(CheckEarlierRun(options).ok());
    WriteBytes(folder.File("result.json"), R"({"state": "finished", "reason": "", "updates": 9})");
    CHECK_THAT(refusal(), Catch::Contains("holds a finished run"));
  }
}

TEST_CASE("A run's name tells it from every other") {
  constexpr LearnerNeeds kOffline = {.dataset = true}, kOnline = {.simulator = true},
                         kHybrid = {.simulator = true, .dataset = true};
  TrainOptions options;
  options.environment = "HalfCheetah";
  options.algorithm = "hymopo";
  options.simulator = "gravity";
  options.dataset = "HalfCheetah/medium";
  CHECK(RunName(options, kHybrid) == "HalfCheetah-hymopo-gravity-medium-s0");
  std::set<std::string> names = {RunName(options, kHybrid)};
  const auto is_new = [&](const LearnerNeeds& needs) {
    const std::string name = RunName(options, needs);
    INFO(name);
    CHECK(name.size() <= kMaxRunNameBytes);
    CHECK(name.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
                                 ".,=+-_") == std::string::npos);
    CHECK(names.insert(name).second);
  };
  options.seed = 1, is_new(kHybrid);
  options.history_length = 3, is_new(kHybrid);
  options.precision = Precision::kBf16, is_new(kHybrid);
  options.corruption = "hidden=9+10", is_new(kHybrid);
  options.corruption = "hidden=9+10,obs-noise=0.1", is_new(kHybrid);
  options.corruption_seed = 1, is_new(kHybrid);
  options.transitions = "d4rl", is_new(kHybrid);
  options.corruption_seed = 0, options.transitions = "stored";
  options.dataset = "medium", is_new(kHybrid);
  options.dataset = "d4rl/halfcheetah-medium-v2", is_new(kHybrid);
  options.dataset = "d4rl_halfcheetah-medium-v2", is_new(kHybrid);
  options.dataset = "HalfCheetah/medium", options.corruption = "";
  options.simulator = "gravity,model=my file.xml", is_new(kHybrid);
  options.simulator = "gravity,model=my_file.xml", is_new(kHybrid);
  options.simulator = "", is_new(kHybrid);
  is_new(kOffline);
  options.simulator = "gravity", options.dataset = "", is_new(kOnline);
  options.simulator = "", is_new(kOnline);
  options.simulator = std::string(1000, 'a'), is_new(kOnline);
  options.simulator += "a", is_new(kOnline);
  options.simulator = "", options.environment = "../..", is_new(kOnline);
  options.environment = "\xff\n", is_new(kOnline);
}

TEST_CASE("A run that was begun without its dataset's version is resumed with it in its folder") {
  const TemporaryFolder folder;
  const std::string before = std::filesystem::current_path();
  std::filesystem::current_path(folder.path());
  constexpr LearnerNeeds kOffline = {.dataset = true};
  TrainOptions options;
  options.environment = "HalfCheetah";
  options.algorithm = "bc";
  options.dataset = "HalfCheetah/medium";
  options.folder = FolderOfRun(options, kOffline);
  CHECK(options.folder == "runs/HalfCheetah-bc-medium-s0");
  std::filesystem::create_directories(options.folder);
  options.dataset = "HalfCheetah/medium-v0";  // as the daemon completes it
  REQUIRE(WriteRunRecord(options).ok());
  CHECK(FolderOfRun(options, kOffline) == "runs/HalfCheetah-bc-medium-v0-s0");
  options.resume = true;
  CHECK(FolderOfRun(options, kOffline) == "runs/HalfCheetah-bc-medium-s0");
  options.dataset = "HalfCheetah/medium-v1";
  CHECK(FolderOfRun(options, kOffline) == "runs/HalfCheetah-bc-medium-v1-s0");
  std::filesystem::current_path(before);
}

TEST_CASE("What a run's record keeps is what is read from it") {
  const Recorded recorded;
  const Result<RunRecord> record = recorded.Read();
  REQUIRE(record.ok());
  CHECK(record->options.algorithm == "sac");
  CHECK(record->options.seed == UINT64_MAX);
  CHECK(record->options.precision == Precision::kBf16);
  CHECK(record->options.eval_every == TrainOptions().eval_every);
}

TEST_CASE("A record is a run's if identity and hyperparameters are, whatever length it has") {
  const TemporaryFolder folder;
  TrainOptions options;
  options.algorithm = "mopo";
  options.environment = "HalfCheetah";
  options.dataset = "HalfCheetah/medium-v0";
  options.folder = folder.File("");
  const HyperparameterTable table = {
      Real("gamma", 0.99, {0, 1}, "discount"),
      Choice("actor", "deterministic|gaussian", 0, "policy", ""),
      WithoutEffect(Switch("cache", true, "", "")),
  };
  options.hyperparameters = Hyperparameters(table);
  REQUIRE(options.hyperparameters.Set("gamma", 0.1).ok());
  REQUIRE(WriteRunRecord(options).ok());
  const Result<RunRecord> record = ReadRunRecord(options.folder);
  REQUIRE(record.ok());
  CHECK(IsRecordOf(*record, options));
  TrainOptions other = options;
  other.updates = 5;
  other.threads = 3;
  REQUIRE(other.hyperparameters.SetText("cache", "false").ok());
  CHECK(IsRecordOf(*record, other));
  SECTION("algorithm") { other.algorithm = "hymopo"; }
  SECTION("seed") { other.seed = 1; }
  SECTION("dataset") { other.dataset = "HalfCheetah/medium-v1"; }
  SECTION("precision") { other.precision = Precision::kBf16; }
  SECTION("a number") { REQUIRE(other.hyperparameters.Set("gamma", 0.2).ok()); }
  SECTION("a choice") { REQUIRE(other.hyperparameters.SetText("actor", "gaussian").ok()); }
  SECTION("a name that is not known") {
    other.hyperparameters = Hyperparameters(std::span(table).first(2));
  }
  CHECK_FALSE(IsRecordOf(*record, other));
}

TEST_CASE("A record without a precision is of a run in fp32, and an unknown one is refused") {
  const Recorded recorded;
  const Result<RunRecord> older = recorded.ReadWith("precision", nullptr);
  REQUIRE(older.ok());
  CHECK(older->options.precision == Precision::kFp32);
  const Result<RunRecord> unknown = recorded.ReadWith("precision", "fp8");
  CHECK(unknown.status().code() == StatusCode::kDataLoss);
  CHECK(unknown.status().message().find("fp32 or bf16") != std::string::npos);
}

TEST_CASE("A record keeps each change of program, kernel and processor that the run went through") {
  const TemporaryFolder folder;
  TrainOptions options;
  options.folder = folder.File("");
  const RunSession present = PresentSession(), older = {"0.0.1", "Prescott", ""};
  RunSession elsewhere = present, earlier = present, for_others = present;
  elsewhere.processor = "another";
  earlier.commit = "ba9876543210";
  for_others.architecture = "x86-64-v3";
  const auto write = [&](const std::vector<RunSession>& before) {
    REQUIRE(WriteRunRecord(options, before).ok());
    const Result<RunRecord> record = ReadRunRecord(options.folder);
    REQUIRE(record.ok());
    return record->sessions;
  };
  CHECK(write({}) == std::vector{present});
  CHECK(write({present}) == std::vector{present});
  CHECK(write({older}) == std::vector{older, present});
  CHECK(write({elsewhere}) == std::vector{elsewhere, present});
  CHECK(write({earlier, for_others}) == std::vector{earlier, for_others, present});
  CHECK(write({present, older}) == std::vector{present, older, present});
  CHECK(write(std::vector<RunSession>(500, older)).size() == 100);
}

TEST_CASE("Another version, kernel, commit or architecture may compute other numbers") {
  const RunSession present = PresentSession();
  CHECK(present.commit == "0123456789ab");
  CHECK(present.ComputesAs(present));
  for (std::string RunSession::*part : {&RunSession::version, &RunSession::blas_kernel,
                                        &RunSession::commit, &RunSession::architecture}) {
    RunSession other = present;
    other.*part = "another";
    CHECK_FALSE(other.ComputesAs(present));
    CHECK_FALSE(other.Text() == present.Text());
  }
  RunSession elsewhere = present;
  elsewhere.processor = "another";
  CHECK(elsewhere.ComputesAs(present));
}

TEST_CASE("A record of an older version names one session") {
  const Recorded recorded;
  const Result<RunRecord> record = recorded.ReadWith("sessions", nullptr);
  REQUIRE(record.ok());
  CHECK(record->sessions == std::vector{PresentSession()});
}

TEST_CASE("A number in a run's record that no option takes is refused by name and range") {
  const Recorded recorded;
  for (const char* name :
       {"eval_every", "log_every", "checkpoint_every", "eval_episodes", "threads", "history"}) {
    for (const Json& value : {Json(0), Json(-1), Json(1.5), Json("1"), Json::array()}) {
      const Status status = recorded.ReadWith(name, value).status();
      INFO(name << " " << value << " " << status.ToString());
      CHECK(status.code() == StatusCode::kDataLoss);
      CHECK(status.message().find(name) != std::string::npos);
      CHECK(status.message().find("1..") != std::string::npos);
    }
    CHECK(recorded.ReadWith(name, 1).ok());
  }
  // These would fit after their upper half is cut off.
  for (const char* name : {"eval_episodes", "threads", "history"}) {
    CHECK(recorded.ReadWith(name, (1ull << 32) + 1).status().code() == StatusCode::kDataLoss);
  }
}

TEST_CASE("A record that nests deeper than a stack is refused") {
  const Recorded recorded;
  const std::string deep = std::string(400'000, '[') + std::string(400'000, ']');
  CHECK(recorded.ReadText("{\"threads\": " + deep + "}").status().code() == StatusCode::kDataLoss);
  CHECK(recorded.ReadText("{\"hyperparameters\": {\"gamma\": " + deep + "}}").status().code() ==
        StatusCode::kDataLoss);
  CHECK(recorded.ReadText("{\"hyperparameters\": []}").status().code() == StatusCode::kDataLoss);
}

}  // namespace b4mrl
