// b4mrl benchmark check says whether results are what they say, and leaderboard ranks them.
#include <sys/stat.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/benchmarks/runner/suite.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

using Json = nlohmann::ordered_json;

const std::string kResults = B4MRL_SOURCE_DIR "/benchmarks/results";

TEST_CASE("The project's own results are sound and make its leaderboard") {
  const Outcome checked = Run({"benchmark", "check", kResults});
  INFO(checked.out << checked.err);
  CHECK(checked.exit_code == 0);
  CHECK(checked.out.find("sound ") != std::string::npos);
  const Outcome board = Run({"benchmark", "leaderboard", kResults});
  CHECK(board.exit_code == 0);
  CHECK(board.out == ReadBytes(B4MRL_SOURCE_DIR "/benchmarks/leaderboard.csv"));
}

TEST_CASE("An agent beside its result is scored again") {
  const Suite suite("bc = 20");
  REQUIRE(Run(suite.Command()).exit_code == 0);
  const Outcome sound = Run({"benchmark", "check", suite.Out()});
  INFO(sound.out << sound.err);
  CHECK(sound.exit_code == 0);
  CHECK(sound.out.find("its agent has these returns") != std::string::npos);

  const fs::path file = fs::directory_iterator(suite.Out() + "/results")->path();
  Json result = Json::parse(ReadBytes(file), nullptr, false);
  result["returns"] = {result["return"].get<double>() + 1e-9};
  WriteBytes(file, result.dump());
  const Outcome altered = Run({"benchmark", "check", suite.Out()});
  INFO(altered.out << altered.err);
  CHECK(altered.exit_code == 1);
  CHECK(altered.out.find("its agent has the returns") != std::string::npos);
}

// The text of the only fault that a change makes to one of the project's results.
std::string FaultOf(const std::string& key, const Json& value) {
  const fs::path original = [] {
    for (const auto& entry : fs::directory_iterator(kResults)) {
      const std::string name = entry.path().filename();
      if (name.starts_with("HalfCheetah-iql-medium-s0-")) return entry.path();
    }
    return fs::path();
  }();
  const TemporaryFolder folder;
  Json result = Json::parse(ReadBytes(original), nullptr, false);
  REQUIRE(result.is_object());
  result[Json::json_pointer(key)] = value;
  WriteBytes(folder.File(original.filename()), result.dump());
  const Outcome outcome = Run({"benchmark", "check", folder.File(original.filename())});
  CHECK(outcome.exit_code == 1);
  CHECK(outcome.out.find("0 of 1 results are sound") != std::string::npos);
  return outcome.out;
}

TEST_CASE("What does not fit the rest of a result is named") {
  const auto says = [](const std::string& key, const Json& value, const std::string& words) {
    const std::string text = FaultOf(key, value);
    CAPTURE(key, value.dump(), words, text);
    return text.find(words) != std::string::npos;
  };
  CHECK(says("/score", 99, "score is 99"));
  CHECK(says("/score", "high", "score is null"));
  CHECK(says("/return", 1, "return is 1"));
  CHECK(says("/returns", {1, 2}, "return is "));
  CHECK(says("/returns", Json::object(), "returns must be a list"));
  CHECK(says("/settled", Json(), "settled is null"));
  CHECK(says("/last_fifth", 1, "last_fifth is 1"));
  CHECK(says("/curve/0", {1}, "curve must be a list"));
  CHECK(says("/updates", 5, "updates is 5"));
  CHECK(says("/planned_updates", 1'000'000, "fewer than planned_updates, 1000000"));
  CHECK(says("/seed", 1, "id is "));
  CHECK(says("/precision", "bf16", "id is "));
  CHECK(says("/hyperparameters/gamma", 0.5, "cell is "));
  CHECK(says("/hyperparameters/gama", 0.5, "did you mean 'gamma'"));
  CHECK(says("/corruption", "hidden=3", "cell is "));
  CHECK(says("/algorithm", "mine", "no algorithm of b4mrl"));
  CHECK(says("/dataset/columns_sha256", "00", "other rows than the published"));
  CHECK(says("/benchmarks/0", "HalfCheetah/clean/mediu", "is in no suite"));
  CHECK(says("/benchmarks/0", "HalfCheetah/clean/medium-expert", "fills no cell of benchmark"));
  CHECK(says("/suite", "v9", "suite is 'v9'"));
  CHECK(says("/benchmarks/1", "HalfCheetah/modelling-error/gravity+medium", "is listed twice"));
  CHECK(says("/selection", "best", "selection is 'best'"));
  CHECK(says("/source", "hearsay", "allowed: own, user, self-scored"));
  CHECK(says("/finished", false, "has not finished"));
  CHECK(says("/ledger", Json(), "ledger.dataset_rows"));
  CHECK(says("/environment", "HalfCheeta", "HalfCheetah"));
}

TEST_CASE("A file that is no result is named and keeps no other back") {
  const TemporaryFolder folder;
  WriteBytes(folder.File("a.json"), "[1]");
  WriteBytes(folder.File("b.json"), "{}");
  const Outcome outcome = Run({"benchmark", "check", folder.path()});
  CHECK(outcome.exit_code == 1);
  CHECK(outcome.out.find("a.json holds no JSON object") != std::string::npos);
  CHECK(outcome.out.find("0 of 2 results are sound") != std::string::npos);
  const Outcome missing = Run({"benchmark", "check", folder.File("none")});
  CHECK(missing.exit_code != 0);
}

TEST_CASE("A pipe in a result's place is named, and nothing waits for its writer") {
  const TemporaryFolder folder;
  REQUIRE(mkfifo(folder.File("a.json").c_str(), 0600) == 0);
  const Outcome outcome = Run({"benchmark", "check", folder.File("a.json")});
  CHECK(outcome.exit_code == 1);
  CHECK(outcome.out.find("a.json is no regular file") != std::string::npos);
}

}  // namespace
}  // namespace b4mrl
