// Files that are not what a runner has left fail their run alone, and no run is begun for ever.
#include <sys/stat.h>

#include <catch2/catch.hpp>
#include <csignal>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/benchmarks/runner/suite.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

using Json = nlohmann::ordered_json;

// A suite of two runs of bc, which have ended; the data of one are hidden in part.
class EndedSuite {
 public:
  EndedSuite() : suite_("bc = 20") {
    suite_.pattern = "HalfCheetah/confounding/*-high+medium";
    REQUIRE(Again().exit_code == 0);
  }
  Outcome Again(const Words& more = {}) const { return Run(suite_.Command(more)); }
  fs::path HiddenResult() const { return EntryOf("/results"); }
  fs::path HiddenRun() const { return EntryOf("/runs"); }
  void ChangeHiddenResult(const Json& changes) const {
    Json result = Json::parse(ReadBytes(HiddenResult()), nullptr, false);
    REQUIRE(result.is_object());
    result.update(changes);
    WriteBytes(HiddenResult(), result.dump());
  }

 private:
  fs::path EntryOf(const std::string& folder) const {
    for (const auto& entry : fs::directory_iterator(suite_.Out() + folder)) {
      if (entry.path().filename().string().find("hidden-high") != std::string::npos) return entry;
    }
    FAIL("no run with hidden-high in " << folder);
    return {};
  }
  Suite suite_;
};

TEST_CASE("A result that cannot be read fails its run and keeps no other back") {
  const EndedSuite suite;
  const std::string deep =
      "{\"scorings\": " + std::string(100'000, '[') + std::string(100'000, ']') + "}";
  for (const std::string& text : {std::string("<<<<<<< HEAD"), std::string(), deep}) {
    WriteBytes(suite.HiddenResult(), text);
    const Outcome outcome = suite.Again();
    INFO(outcome.out << outcome.err);
    CHECK(outcome.exit_code == 1);
    CHECK(outcome.out.find("1 of 2 runs done, 1 failed") != std::string::npos);
    CHECK(outcome.out.find(suite.HiddenResult().string() + " holds no JSON object") !=
          std::string::npos);
  }
}

TEST_CASE("A pipe in a result's place fails its run, and nothing waits for its writer") {
  const EndedSuite suite;
  const fs::path result = suite.HiddenResult();
  fs::remove(result);
  REQUIRE(mkfifo(result.c_str(), 0600) == 0);
  const Outcome outcome = suite.Again();
  INFO(outcome.out << outcome.err);
  CHECK(outcome.exit_code == 1);
  CHECK(outcome.out.find("is no regular file") != std::string::npos);
  const Outcome board = Run({"benchmark", "leaderboard", result.parent_path().string()});
  CHECK(board.exit_code == 0);
}

TEST_CASE("A run whose folder cannot be made has failed and keeps no other back") {
  const EndedSuite suite;
  fs::remove(suite.HiddenResult());
  const fs::path folder = suite.HiddenRun();
  fs::remove_all(folder);
  WriteBytes(folder, "");
  const Outcome outcome = suite.Again();
  INFO(outcome.out << outcome.err);
  CHECK(outcome.exit_code == 1);
  CHECK(outcome.out.find("1 of 2 runs done, 1 failed") != std::string::npos);
  CHECK(outcome.out.find("make the folder " + folder.string()) != std::string::npos);
}

TEST_CASE("A run whose result does not take what was made for it is tried again and has failed") {
  const EndedSuite suite;
  // Further than the folder's log, with the folder's agent.
  suite.ChangeHiddenResult({{"updates", 999}, {"scorings", Json::object()}});
  const Outcome outcome = suite.Again();
  INFO(outcome.out << outcome.err);
  CHECK(outcome.exit_code == 1);
  CHECK(outcome.out.find("ended with code 0 and left less") != std::string::npos);
}

TEST_CASE("A result that has come further is not scored with the folder's agent") {
  const EndedSuite suite;
  suite.ChangeHiddenResult(
      {{"updates", 999}, {"agent_sha256", std::string(64, '0')}, {"scorings", Json::object()}});
  const std::string before = ReadBytes(suite.HiddenResult());
  const Outcome outcome = suite.Again();
  INFO(outcome.out << outcome.err);
  CHECK(outcome.exit_code == 0);
  CHECK(ReadBytes(suite.HiddenResult()) == before);
  // Nobody takes it for one that has all its scores.
  const std::string lacks =
      "lacks the scorings full, and " + suite.HiddenRun().string() + " no longer holds its agent";
  CHECK(outcome.err.find(lacks) != std::string::npos);
  CHECK(suite.Again({"--dry-run"}).err.find(lacks) != std::string::npos);
}

TEST_CASE("A finished result takes the scorings that it lacks from the agent in its folder") {
  const EndedSuite suite;
  const Json before = Json::parse(ReadBytes(suite.HiddenResult()), nullptr, false);
  suite.ChangeHiddenResult({{"scorings", Json::object()}});
  const Outcome outcome = suite.Again();
  INFO(outcome.out << outcome.err);
  CHECK(outcome.exit_code == 0);
  CHECK(outcome.err.find("lacks") == std::string::npos);
  CHECK(outcome.err.find("start ") == std::string::npos);  // nothing is trained
  const Json after = Json::parse(ReadBytes(suite.HiddenResult()), nullptr, false);
  CHECK(after["scorings"].size() == 1);
  CHECK(after["scorings"] == before["scorings"]);
}

TEST_CASE("A run that was cut off beyond the budget ends with a finished result") {
  const EndedSuite suite;
  suite.ChangeHiddenResult({{"updates", 21}, {"planned_updates", 100}, {"finished", false}});
  const Outcome outcome = suite.Again();
  INFO(outcome.out << outcome.err);
  CHECK(outcome.exit_code == 0);
  CHECK(outcome.out.find("2 of 2 runs done") != std::string::npos);
  const Json result = Json::parse(ReadBytes(suite.HiddenResult()), nullptr, false);
  CHECK(result["finished"] == true);
  CHECK(result["updates"] == 20);  // its folder was no longer there to go on from
}

TEST_CASE("A run that was stopped beyond the budget ends where it is") {
  Suite suite("bc = 20");
  suite.pattern = "HalfCheetah/modelling-error/gravity+medium";
  REQUIRE(Run(suite.Command()).exit_code == 0);
  fs::remove_all(suite.Out() + "/results");
  fs::remove_all(suite.Out() + "/runs");
  const auto take = [&](const char* updates) {
    WriteBytes(
        suite.File("budget.toml"),
        std::string("[tiny]\nevaluations = 2\nepisodes = 1\nrows = 2_000\nupdates = { bc = ") +
            updates + " }\n");
  };
  take("100_000_000");  // more than seven seconds are enough for
  Run(suite.Command({"--hours", "0.002"}));
  take("20");
  const Outcome outcome = Run(suite.Command());
  INFO(outcome.out << outcome.err);
  CHECK(outcome.exit_code == 0);
  const Json result = Json::parse(suite.Results().begin()->second, nullptr, false);
  CHECK(result["finished"] == true);
  CHECK(result["updates"] > 20);
}

TEST_CASE("Data with another number of rows than a run was planned for are refused before it") {
  Suite suite("bc = 20");
  suite.pattern = "HalfCheetah/modelling-error/gravity+medium";
  REQUIRE(Run(suite.Command()).exit_code == 0);
  WriteBytes(suite.File("budget.toml"),
             "[tiny]\nevaluations = 2\nepisodes = 1\nrows = 3_000\nupdates = { bc = 20 }\n");
  const Outcome outcome = Run(suite.Command());
  INFO(outcome.out << outcome.err);
  CHECK(outcome.exit_code == 1);
  CHECK(outcome.out.find("has 2000 rows, not the 3000 of this run") != std::string::npos);
  CHECK(suite.Results().size() == 1);
  Words status = suite.Command();
  status[1] = "status";
  const Outcome told = Run(status);
  CHECK(told.out.find("failed") != std::string::npos);
  CHECK(told.out.find("has 2000 rows, not the 3000 of this run") != std::string::npos);
}

TEST_CASE("A run whose folder cannot be locked has failed, and nobody waits for it") {
  const EndedSuite suite;
  fs::remove(suite.HiddenResult());
  fs::remove(suite.HiddenRun() / "lock");
  fs::create_directory(suite.HiddenRun() / "lock");
  const Outcome outcome = suite.Again();
  INFO(outcome.out << outcome.err);
  CHECK(outcome.exit_code == 1);
  CHECK(outcome.out.find("/lock") != std::string::npos);
}

TEST_CASE("Who looks at one run of a list that was not written writes none") {
  const Suite suite("bc = 20");
  const Outcome outcome = Run(suite.Command({"--dry-run", "--index", "0"}));
  INFO(outcome.err);
  CHECK(outcome.exit_code == 0);
  CHECK_FALSE(fs::exists(suite.Out() + "/plan.json"));
}

TEST_CASE("A run that goes on is scored anew") {
  Suite suite("bc = 20");
  suite.pattern = "HalfCheetah/confounding/hidden-high+medium";
  REQUIRE(Run(suite.Command()).exit_code == 0);
  const auto full = [&] {
    const auto json = Json::parse(suite.Results().begin()->second, nullptr, false);
    return json["scorings"]["full"]["returns"].dump();
  };
  const std::string before = full();
  WriteBytes(suite.File("budget.toml"),
             "[tiny]\nevaluations = 2\nepisodes = 1\nrows = 2_000\nupdates = { bc = 40 }\n");
  REQUIRE(Run(suite.Command()).exit_code == 0);
  CHECK(full().size() > 4);
  CHECK(full() != before);
}

TEST_CASE("A result that its user has removed is not written of the training before") {
  const Suite suite("td3-bc = 60");
  REQUIRE(Run(suite.Command()).exit_code == 0);
  std::filesystem::remove_all(suite.File("suite/results"));
  // The first evaluation of the new training is not reached.
  WriteBytes(suite.File("budget.toml"),
             "[tiny]\nevaluations = 1\nepisodes = 1\nrows = 2_000\n"
             "updates = { td3-bc = 1_000_000 }\n");
  Tool runner(suite.Command());
  REQUIRE(runner.WaitForMessage("start "));
  runner.Signal(SIGTERM);
  const Outcome stopped = runner.Wait();
  INFO(stopped.out << stopped.err);
  CHECK(suite.Results().empty());
}

TEST_CASE("What a learner has learned from other rows than those at hand does not count") {
  const Suite suite("bc = 20");
  WriteBytes(suite.File("budget.toml"),
             "[tiny]\nepisodes = 1\nrows = 2_000\nlearner-updates = 7\nupdates = { bc = 20 }\n");
  const std::string data = suite.File("data");
  REQUIRE(std::filesystem::create_directory(data));
  const auto make = [&](const char* rows, const char* seed) {
    REQUIRE(Run({"dataset", "make", "HalfCheetah/medium", "--replace", "--rows", rows, "--seed",
                 seed, "--data", data})
                .exit_code == 0);
  };
  const auto train = [&] {
    return Run(
        suite.Command({"--learner", "echo '{\"returns\": [1]}' > \"$B4MRL_OUT/returns.json\"",
                       "--name", "mine", "--data-folder", data}));
  };
  make("500", "0");
  const Outcome refused = train();
  INFO(refused.out << refused.err);
  CHECK(refused.exit_code == 1);
  CHECK(Says(refused.out,
             "has 500 rows, not the 2000 of this run; make it again (b4mrl dataset "
             "make HalfCheetah/medium --replace --rows 2000 --data " +
                 data + ")"));
  CHECK_FALSE(Says(refused.err, "start "));

  make("2000", "0");
  const Outcome first = train();
  INFO(first.out << first.err);
  CHECK(first.exit_code == 0);
  CHECK(Says(first.err, "start "));
  std::filesystem::remove_all(suite.Out() + "/results");
  CHECK_FALSE(Says(train().err, "start "));  // as if its runner had been killed
  std::filesystem::remove_all(suite.Out() + "/results");
  make("2000", "1");
  const Outcome again = train();
  INFO(again.out << again.err);
  CHECK(again.exit_code == 0);
  CHECK(Says(again.err, "start "));
}

}  // namespace
}  // namespace b4mrl
