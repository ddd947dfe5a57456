// A learner of the user's own trains in a suite, and its rows stand among the results.
#include <fmt/format.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/benchmarks/runner/suite.h"
#include "tests/integration/support/daemon.h"

namespace b4mrl {
namespace {

// As a word of a shell's command.
constexpr char kAgent[] = "'" B4MRL_SOURCE_DIR "/data/agents/halfcheetah-medium.h5'";

TEST_CASE("A learner that leaves an agent is told what to do, and its agent is scored") {
  const UsersSuite suite;
  const std::string seen = suite.File("seen");
  const Outcome outcome = suite.Train("env | grep ^B4MRL_ | sort >> " + seen + "; cp " + kAgent +
                                      " \"$B4MRL_OUT/agent.h5\"");
  INFO(outcome.out << outcome.err);
  REQUIRE(outcome.exit_code == 0);
  const std::string variables = ReadBytes(seen);
  INFO(variables);
  for (const char* line : {"B4MRL_BENCHMARK=HalfCheetah/confounding/hidden-high+medium\n",
                           "B4MRL_CORRUPTION=hidden-low\n", "B4MRL_SIMULATOR=gravity\n",
                           "B4MRL_DATASET=HalfCheetah/medium-v0\n", "B4MRL_UPDATES=70\n",
                           "B4MRL_SEED=0\n", "B4MRL_ENVIRONMENT=HalfCheetah\n"}) {
    CAPTURE(line);
    CHECK(variables.find(line) != std::string::npos);
  }
  const auto results = suite.Results();
  REQUIRE(results.size() == 2);
  for (const auto& [name, text] : results) {
    const auto json = nlohmann::json::parse(text, nullptr, false);
    CAPTURE(name, text);
    CHECK(json["algorithm"] == "mine");
    CHECK(json["source"] == "user");
    CHECK(json["finished"] == true);
    // The agent is one of 40 points on the true HalfCheetah. Its file has no mask, but a dimension
    // was hidden from whoever trained on this benchmark.
    CHECK(json["scorings"]["full"]["score"].get<double>() > 30);
    CHECK(json["score"] < json["scorings"]["full"]["score"]);
    CHECK(json["scorings"].size() == 1);
    CHECK(json["ledger"]["evaluation_episodes"] == 1);
    CHECK(json["ledger"]["dataset_rows"] == 0);
  }
  const Outcome again = suite.Train("false");
  CHECK(again.exit_code == 0);  // all is done, by another command
  CHECK(again.err.find("was trained by another --learner; remove ") != std::string::npos);
  const Outcome checked = Run({"benchmark", "check", suite.File("suite")});
  INFO(checked.out);
  CHECK(checked.exit_code == 0);
  CHECK(checked.out.find("its agent has these returns") != std::string::npos);
}

TEST_CASE("What a learner leaves for itself stays when its run is done") {
  const UsersSuite suite;
  const Outcome outcome = suite.Train(
      "mkdir -p \"$B4MRL_OUT/checkpoint-70\" && touch \"$B4MRL_OUT/replay.bin\" && "
      "echo '{\"returns\": [1]}' > \"$B4MRL_OUT/returns.json\"");
  INFO(outcome.out << outcome.err);
  REQUIRE(outcome.exit_code == 0);
  size_t runs = 0;
  for (const auto& run : std::filesystem::directory_iterator(suite.File("suite/runs"))) {
    CHECK(std::filesystem::exists(run.path() / "checkpoint-70"));
    CHECK(std::filesystem::exists(run.path() / "replay.bin"));
    ++runs;
  }
  CHECK(runs == 2);
}

TEST_CASE("An agent that another program has scored is held against its mean return") {
  const UsersSuite suite;
  REQUIRE(suite.Train("cp " + std::string(kAgent) + " \"$B4MRL_OUT/agent.h5\"").exit_code == 0);
  for (const auto& entry : std::filesystem::directory_iterator(suite.File("suite/results"))) {
    auto result = nlohmann::json::parse(ReadBytes(entry.path()), nullptr, false);
    result["budget"] = nullptr;  // as in the results of Python's bench.record
    WriteBytes(entry.path(), result.dump());
  }
  const Outcome checked = Run({"benchmark", "check", suite.File("suite")});
  INFO(checked.out);
  CHECK(checked.exit_code == 0);
  CHECK(checked.out.find("(its agent has the mean return ") != std::string::npos);
  CHECK(checked.out.find(" apart is chance)") != std::string::npos);
  for (const auto& entry : std::filesystem::directory_iterator(suite.File("suite/results"))) {
    auto result = nlohmann::json::parse(ReadBytes(entry.path()), nullptr, false);
    result["returns"] = std::vector<double>(1025, result["return"].get<double>());
    WriteBytes(entry.path(), result.dump());
  }
  const Outcome many = Run({"benchmark", "check", suite.File("suite")});
  INFO(many.out);
  CHECK(many.out.find("is 1025, allowed: at most 1024") != std::string::npos);
}

TEST_CASE("A learner finds the benchmark of its user's own suite at the daemon that it is given") {
  Suite suite;
  const TemporaryFolder suites;
  WriteBytes(suites.File("mine.toml"),
             "version = \"v0\"\nenvironment = \"Hopper\"\n[[challenge]]\nname = \"mine\"\n"
             "simulators = [\"gravity\"]\n");
  WriteBytes(suite.File("budget.toml"),
             "[tiny]\nepisodes = 1\nrows = 2_000\nlearner-updates = 70\nupdates = { bc = 20 }\n");
  suite.pattern = "Hopper/mine/*";
  const std::string seen = suite.File("seen");
  // The folder is named as users name it: as seen from where they are.
  const std::string relative = std::filesystem::relative(suites.path());
  const std::string learner = fmt::format(
      "'{}' list benchmarks --endpoint $B4MRL_ENDPOINT > {}; test -f $B4MRL_SUITES/mine.toml "
      "&& cd / && test -f $B4MRL_SUITES/mine.toml && echo '{{\"returns\": [1]}}' > "
      "\"$B4MRL_OUT/returns.json\"",
      B4MRL_BINARY_DIR "/b4mrl", seen);
  const Outcome outcome =
      Run(suite.Command({"--suites", relative, "--learner", learner, "--name", "mine"}));
  INFO(outcome.out << outcome.err);
  CHECK(outcome.exit_code == 0);
  const std::string listed = ReadBytes(seen);
  INFO(listed);
  CHECK(listed.find("Hopper/mine/gravity") != std::string::npos);
}

TEST_CASE("Returns that a learner has measured itself are marked as such") {
  const UsersSuite suite;
  const Outcome outcome = suite.Train(
      "echo '{\"returns\": [1, 2], \"updates\": 7}' > \"$B4MRL_OUT/returns.json\"", "other");
  INFO(outcome.out << outcome.err);
  REQUIRE(outcome.exit_code == 0);
  for (const auto& [name, text] : suite.Results(false)) {
    const auto json = nlohmann::json::parse(text, nullptr, false);
    CAPTURE(name, text);
    CHECK(json["source"] == "self-scored");
    CHECK(json["return"] == 1.5);
    CHECK(json["updates"] == 7);
    CHECK(json["scorings"].empty());
    CHECK(json["score"].get<double>() ==
          Approx(2.2688).epsilon(1e-4));  // by HalfCheetah's reference returns
  }
}

TEST_CASE("The learner in C++ among the examples trains in a suite and is counted there") {
  const UsersSuite suite;
  const Outcome outcome = suite.Train(B4MRL_BINARY_DIR "/own_learner", "lms");
  INFO(outcome.out << outcome.err);
  REQUIRE(outcome.exit_code == 0);
  for (const auto& [name, text] : suite.Results(false)) {
    const auto json = nlohmann::json::parse(text, nullptr, false);
    CAPTURE(name, text);
    CHECK(json["source"] == "self-scored");
    CHECK(json["returns"].size() == 10);
    CHECK(json["updates"] == 70);
    CHECK(json["ledger"]["dataset_rows"] >= 70);  // some are asked for ahead
    CHECK(json["ledger"]["dataset_rows"] < 140);
  }
  // A start that fails after all its work counts, too.
  const std::string twice = B4MRL_BINARY_DIR
      "/own_learner && test -e \"$B4MRL_OUT/mine\" || { touch \"$B4MRL_OUT/mine\"; exit 1; }";
  REQUIRE(suite.Train(twice, "twice").exit_code == 0);
  size_t of_twice = 0;
  for (const auto& [name, text] : suite.Results(false)) {
    const auto json = nlohmann::json::parse(text, nullptr, false);
    CAPTURE(name, text);
    if (json["algorithm"] != "twice") continue;
    CHECK(json["ledger"]["dataset_rows"] >= 140);
    ++of_twice;
  }
  CHECK(of_twice == 2);
}

TEST_CASE("A learner that leaves nothing, or what cannot be understood, has failed") {
  const UsersSuite suite;
  const Outcome nothing = suite.Train("true");
  CHECK(nothing.exit_code == 1);
  CHECK(nothing.out.find("left neither agent.h5 nor returns.json") != std::string::npos);
  const Outcome text =
      suite.Train("echo '{\"returns\": [\"many\"]}' > \"$B4MRL_OUT/returns.json\"");
  CHECK(text.exit_code == 1);
  CHECK(text.out.find("1 to 10000 numbers as \"returns\"") != std::string::npos);
  for (const char* word : {"NaN", "-Infinity"}) {  // as Python's json.dump writes them
    const Outcome infinite = suite.Train("echo '{\"note\": \"a NaN\", \"returns\": [1, " +
                                         std::string(word) + "]}' > \"$B4MRL_OUT/returns.json\"");
    CHECK(infinite.exit_code == 1);
    CHECK_THAT(infinite.out, Catch::Contains(std::string("returns.json holds no JSON object: ") +
                                             word + " is no number of JSON"));
  }
  const Outcome broken = suite.Train("exit 3");
  CHECK(broken.exit_code == 1);
  CHECK(broken.out.find("ended with code 3") != std::string::npos);
  const Outcome taken = suite.Train("true", "iql");
  CHECK(taken.exit_code == 2);
  CHECK(taken.err.find("no algorithm of b4mrl has") != std::string::npos);
}

TEST_CASE("An agent that is not of the environment is refused, and its learner begun anew") {
  const UsersSuite suite;
  const Outcome outcome =
      suite.Train("cp " B4MRL_SOURCE_DIR "/data/agents/hopper-medium.h5 \"$B4MRL_OUT/agent.h5\"");
  INFO(outcome.out << outcome.err);
  CHECK(outcome.exit_code == 1);
  CHECK(outcome.out.find("agent of HalfCheetah, with 17 observation and 6 action dimensions") !=
        std::string::npos);
  const Outcome right = suite.Train("cp " + std::string(kAgent) + " \"$B4MRL_OUT/agent.h5\"");
  INFO(right.out << right.err);
  CHECK(right.exit_code == 0);
  CHECK(suite.Results().size() == 2);
}

TEST_CASE("A learner trains again for a larger budget, and what it leaves then is its result") {
  const UsersSuite suite;
  const std::string learner =
      "echo \"{\\\"returns\\\": [$B4MRL_UPDATES]}\" > \"$B4MRL_OUT/returns.json\"";
  REQUIRE(suite.Train(learner).exit_code == 0);
  const Outcome same = suite.Train(learner);
  CHECK(same.err.find("start ") == std::string::npos);
  CHECK(same.err.find("another --learner") == std::string::npos);
  suite.AskFor("700");
  const Outcome more = suite.Train(learner);
  INFO(more.out << more.err);
  CHECK(more.exit_code == 0);
  for (const auto& [name, text] : suite.Results(false)) {
    const auto json = nlohmann::json::parse(text, nullptr, false);
    CHECK(json["return"] == 700);
    CHECK(json["planned_updates"] == 700);
  }
  suite.AskFor("70");
  CHECK(suite.Train(learner).err.find("start ") == std::string::npos);
}

TEST_CASE("What an earlier attempt has left is not taken for what a learner brings") {
  const UsersSuite suite;
  const Outcome failed =
      suite.Train("cp " + std::string(kAgent) + " \"$B4MRL_OUT/agent.h5\"; exit 3");
  CHECK(failed.exit_code == 1);
  const Outcome nothing = suite.Train("true");
  CHECK(nothing.out.find("left neither agent.h5 nor returns.json") != std::string::npos);
  REQUIRE(suite.Train("cp " + std::string(kAgent) + " \"$B4MRL_OUT/agent.h5\"; exit 3").exit_code ==
          1);
  const Outcome returns = suite.Train("echo '{\"returns\": [1]}' > \"$B4MRL_OUT/returns.json\"");
  INFO(returns.out << returns.err);
  CHECK(returns.exit_code == 0);
  for (const auto& [name, text] : suite.Results(false)) {
    CHECK(nlohmann::json::parse(text, nullptr, false)["source"] == "self-scored");
  }
}

TEST_CASE("A learner that leaves its curve has settled once the last two fifths agree") {
  const UsersSuite suite;
  const auto settled = [&](const std::string& before, const std::string& name) {
    const Outcome outcome = suite.Train(
        "echo '{\"curve\": [{\"updates\": 50, \"returns\": [" + before +
            "], \"steps\": 9}, {\"updates\": 70, \"returns\": [0]}]}' > \"$B4MRL_OUT/curve.json\"; "
            "echo '{\"returns\": [1, 2]}' > \"$B4MRL_OUT/returns.json\"",
        name);
    INFO(outcome.out << outcome.err);
    REQUIRE(outcome.exit_code == 0);
    for (const auto& [file, text] : suite.Results(false)) {
      const auto json = nlohmann::json::parse(text, nullptr, false);
      if (json["algorithm"] != name) continue;
      CAPTURE(text);
      REQUIRE(json["curve"].size() == 2);  // that of the last update is the run's score
      CHECK(json["curve"][0][0] == 50);
      CHECK(json["curve"][0][1] == 9);
      CHECK(json["curve"][1][2] == 1.5);
      CHECK(json["ledger"]["evaluation_episodes"] == 4);
      return json["settled"];
    }
    return nlohmann::json();
  };
  CHECK(settled("3, 5", "steady") == true);
  CHECK(settled("3, 5000", "moving") == false);
  const Outcome checked = Run({"benchmark", "check", suite.File("suite")});
  INFO(checked.out);
  CHECK(checked.exit_code == 0);
}

TEST_CASE("A learner whose agent is gone begins anew, whether or not it was scored") {
  const UsersSuite suite;
  const std::string seen = suite.File("seen");
  const std::string learner =
      "echo begun >> " + seen + "; cp " + kAgent + " \"$B4MRL_OUT/agent.h5\"";
  REQUIRE(suite.Train(learner).exit_code == 0);
  std::filesystem::remove_all(suite.File("suite/results"));
  std::vector<std::filesystem::path> runs, files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(suite.File("suite"))) {
    if (entry.path().filename() == "learned.json") runs.push_back(entry.path().parent_path());
  }
  REQUIRE(runs.size() == 2);
  for (const auto& run : runs) {  // as if it had not been scored yet, either
    for (const auto& entry : std::filesystem::directory_iterator(run)) {
      if (entry.path().filename() != "learned.json") files.push_back(entry.path());
    }
  }
  for (const auto& file : files) std::filesystem::remove_all(file);
  const Outcome again = suite.Train(learner);
  INFO(again.out << again.err);
  CHECK(again.exit_code == 0);
  CHECK(suite.Results().size() == 2);
  CHECK(ReadBytes(seen) == "begun\nbegun\nbegun\nbegun\n");
  // An agent that its user has removed, with its result: its score is no reason to keep it.
  std::filesystem::remove_all(suite.File("suite/results"));
  for (const auto& run : runs) std::filesystem::remove(run / "agent.h5");
  REQUIRE(suite.Train(learner).exit_code == 0);
  CHECK(suite.Results().size() == 2);
  CHECK(ReadBytes(seen) == "begun\nbegun\nbegun\nbegun\nbegun\nbegun\n");
}

TEST_CASE("A learner that was told to stop has not finished, whatever it leaves and returns") {
  const UsersSuite suite;
  // Makes the dataset, which would take a part of the little time.
  REQUIRE(
      suite.Train("echo '{\"returns\": [1]}' > \"$B4MRL_OUT/returns.json\"", "other").exit_code ==
      0);
  const Outcome stopped = suite.Train(
      "trap 'echo \"{\\\"returns\\\": [1]}\" > \"$B4MRL_OUT/returns.json\"; exit 0' TERM; sleep 60 "
      "& wait",
      "mine", {"--hours", "0.001"});
  INFO(stopped.out << stopped.err);
  CHECK(stopped.out.find("0 of 2 runs done, 0 failed, 2 left") != std::string::npos);
  CHECK(stopped.err.find("start ") != std::string::npos);
}

TEST_CASE("A curve that cannot be understood is left out, and the training counts") {
  const auto says = [](const std::string& curve) {
    const UsersSuite suite;
    const Outcome outcome =
        suite.Train("echo '{\"returns\": [1]}' > \"$B4MRL_OUT/returns.json\"; echo '" + curve +
                    "' > \"$B4MRL_OUT/curve.json\"");
    CHECK(outcome.exit_code == 0);
    CHECK(suite.Results(false).size() == 2);
    return outcome.err;
  };
  CHECK_THAT(says(R"({"curve": [{"updates": 2, "returns": [NaN]}]})"), Catch::Contains("NaN"));
  CHECK_THAT(says("{}"), Catch::Contains("a list of up to 10000 points as \"curve\""));
  CHECK_THAT(says(R"({"curve": [{"updates": 2, "returns": [1]}, {"updates": 1, "returns": [1]}]})"),
             Catch::Contains("ascending whole numbers"));
  CHECK_THAT(says(R"({"curve": [{"updates": 2, "returns": []}]})"),
             Catch::Contains("numbers as \"returns\""));
}

TEST_CASE("A suite whose daemon is gone ends, and names no run as failed") {
  const UsersSuite suite;
  REQUIRE(std::filesystem::create_directory(suite.File("data")));
  const PrivateDaemon daemon = StartDaemon({.data_folder = suite.File("data")});
  const std::string kill = fmt::format(
      "echo '{{\"returns\": [1]}}' > \"$B4MRL_OUT/returns.json\"; "
      "test -e {0} || {{ touch {0}; kill -9 {1}; }}",
      suite.File("killed"), daemon.process_id());
  const Outcome outcome =
      suite.Train(kill, "mine", {"--jobs", "1", "--endpoint", daemon.endpoint()});
  INFO(outcome.out << outcome.err);
  CHECK(outcome.exit_code == 4);
  REQUIRE(outcome.err.find("start ") != std::string::npos);
  CHECK(outcome.err.find("start ") == outcome.err.rfind("start "));  // the other run was not begun
  CHECK(outcome.err.find("fail ") == std::string::npos);

  // What has trained to its end is not trained again.
  const Outcome again =
      suite.Train(kill, "mine", {"--jobs", "1", "--data-folder", suite.File("data")});
  INFO(again.out << again.err);
  CHECK(again.exit_code == 0);
  CHECK(suite.Results(false).size() == 2);
  CHECK(again.err.find("start ") == again.err.rfind("start "));
}

}  // namespace
}  // namespace b4mrl
