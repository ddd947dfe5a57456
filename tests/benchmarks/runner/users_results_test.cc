// The results of a user's own learner say what it was asked for and what it has learned from.
#include <catch2/catch.hpp>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/benchmarks/runner/suite.h"
#include "tests/integration/support/daemon.h"

namespace b4mrl {
namespace {

// A learner that stops early, however many updates it is asked for, and comes to the same numbers.
constexpr char kStopsEarly[] =
    "echo '{\"returns\": [1], \"updates\": 7}' > \"$B4MRL_OUT/returns.json\"";

TEST_CASE("A learner that comes to the same numbers for a larger budget is done with it") {
  const UsersSuite suite;
  REQUIRE(suite.Train(kStopsEarly).exit_code == 0);
  suite.AskFor("700");
  const Outcome more = suite.Train(kStopsEarly);
  INFO(more.out << more.err);
  CHECK(more.exit_code == 0);
  CHECK(Count(more.err, "start ") == 2);  // each run once
  for (const auto& [name, text] : suite.Results(false)) {
    CHECK(nlohmann::json::parse(text, nullptr, false)["planned_updates"] == 700);
  }
  CHECK(Count(suite.Train(kStopsEarly).err, "start ") == 0);
}

// The hash of the rows that the suite's learner has learned from.
std::string RowsOf(const Suite& suite) {
  const auto results = suite.Results(false);
  REQUIRE(results.size() == 1);
  const auto result = nlohmann::json::parse(results.begin()->second, nullptr, false);
  return result["dataset"]["columns_sha256"].get<std::string>();
}

TEST_CASE("A learner begins anew where its dataset has other rows, and an own run says so") {
  Suite suite;
  suite.pattern = "HalfCheetah/clean/medium";
  WriteBytes(suite.File("budget.toml"),
             "[tiny]\nepisodes = 1\nrows = 2_000\nlearner-updates = 70\nupdates = { bc = 20 }\n");
  const std::string data = suite.File("data");
  REQUIRE(std::filesystem::create_directory(data));
  const auto make = [&](const std::string& seed) {
    const Outcome made = Run({"dataset", "make", "HalfCheetah/medium", "--replace", "--rows",
                              "2000", "--seed", seed, "--data", data});
    REQUIRE(made.exit_code == 0);
  };
  const auto run = [&](const Words& more = {}) {
    Words words = {"--data-folder", data};
    words.insert(words.end(), more.begin(), more.end());
    return Run(suite.Command(words));
  };
  const Words learner = {"--learner", kStopsEarly, "--name", "mine"};
  make("0");
  REQUIRE(run(learner).exit_code == 0);
  const std::string before = RowsOf(suite);
  CHECK(Count(run(learner).err, "start ") == 0);
  make("1");
  const Outcome anew = run(learner);
  INFO(anew.out << anew.err);
  CHECK(anew.exit_code == 0);
  CHECK(Count(anew.err, "start ") == 1);
  CHECK(RowsOf(suite) != before);
  CHECK(Count(run(learner).err, "start ") == 0);

  REQUIRE(run().exit_code == 0);  // bc's
  make("0");
  REQUIRE(run(learner).exit_code == 0);  // which counts the rows
  const Outcome own = run();
  INFO(own.out << own.err);
  CHECK(own.exit_code == 0);
  CHECK(Count(own.err, "start ") == 0);
  CHECK(own.err.find("learned from other rows of HalfCheetah/medium-v0 than those at hand; "
                     "remove ") != std::string::npos);
}

TEST_CASE("A learner is not started where the daemon lacks the suite of its benchmark") {
  const UsersSuite suite;
  const TemporaryFolder suites;
  WriteBytes(suites.File("mine.toml"),
             "version = \"v0\"\nenvironment = \"HalfCheetah\"\n[[challenge]]\n"
             "name = \"confounding\"\ncorruptions = [\"hidden-low\"]\nlabel = \"hidden-mine\"\n"
             "datasets = [\"medium\"]\n");
  const PrivateDaemon elsewhere = StartDaemon({.data_folder = suites.path()});
  const Outcome outcome = suite.Train(
      kStopsEarly, "mine", {"--suites", suites.path(), "--endpoint", elsewhere.endpoint()});
  INFO(outcome.out << outcome.err);
  CHECK(outcome.exit_code == 3);
  CHECK(outcome.err.find("has no benchmark 'HalfCheetah/confounding/hidden-mine+hidden-low+medium'"
                         "; start it with `b4mrl serve --suites FOLDER`") != std::string::npos);
  CHECK(Count(outcome.err, "start HalfCheetah") == 0);
}

}  // namespace
}  // namespace b4mrl
