// b4mrl benchmark check says whether results are what they say, and leaderboard ranks them.
#include <sys/stat.h>

#include <algorithm>
#include <catch2/catch.hpp>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "data/files/file_hash.h"
#include "tests/benchmarks/runner/suite.h"
#include "tests/results.h"

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
  // It is scored by this version's daemon, whichever one the user works with.
  CHECK(Run({"benchmark", "check", suite.Out()}, {"B4MRL_ENDPOINT=ipc:///nowhere/socket"}).out ==
        sound.out);

  const fs::path file = fs::directory_iterator(suite.Out() + "/results")->path();
  Json result = Json::parse(ReadBytes(file), nullptr, false);
  result["returns"] = {result["return"].get<double>() + 1e-9};
  WriteBytes(file, result.dump());
  const Outcome altered = Run({"benchmark", "check", suite.Out()});
  INFO(altered.out << altered.err);
  CHECK(altered.exit_code == 1);
  CHECK(altered.out.find("its agent has the returns") != std::string::npos);
}

TEST_CASE("An agent that was trained on other data than its result says is no evidence for it") {
  Suite suite("bc = 20");
  suite.pattern = "HalfCheetah/clean/medium";
  REQUIRE(Run(suite.Command()).exit_code == 0);
  const fs::path clean = fs::directory_iterator(suite.Out() + "/results")->path();
  suite.pattern = "HalfCheetah/confounding/hidden-high+medium";
  REQUIRE(Run(suite.Command()).exit_code == 0);
  for (const auto& entry : fs::directory_iterator(suite.Out() + "/results")) {
    if (entry.path() == clean) continue;
    Json hidden = Json::parse(ReadBytes(entry.path()), nullptr, false);
    hidden["agent_sha256"] = Json::parse(ReadBytes(clean), nullptr, false)["agent_sha256"];
    WriteBytes(entry.path(), hidden.dump());
  }
  const Outcome checked = Run({"benchmark", "check", suite.Out()});
  INFO(checked.out << checked.err);
  CHECK(checked.out.find("1 of 2 results are sound") != std::string::npos);
  CHECK(checked.out.find("its agent has the corruption '', the result 'hidden=9'") !=
        std::string::npos);
  CHECK(checked.out.find("its agent sees dimension 9, which was hidden from it") !=
        std::string::npos);
}

TEST_CASE("One seed's result does not stand for another's") {
  const Suite suite("bc = 20");
  REQUIRE(Run(suite.Command({"--seeds", "0..1"})).exit_code == 0);
  std::vector<fs::path> seeds;
  for (const auto& entry : fs::directory_iterator(suite.Out() + "/results")) {
    seeds.push_back(entry.path());
  }
  std::ranges::sort(seeds);
  REQUIRE(seeds.size() == 2);
  Json copy = Json::parse(ReadBytes(seeds[0]), nullptr, false);
  const Json other = Json::parse(ReadBytes(seeds[1]), nullptr, false);
  for (const char* key : {"id", "seed"}) copy[key] = other[key];
  WriteBytes(seeds[1], copy.dump());
  const Outcome checked = Run({"benchmark", "check", suite.Out()});
  INFO(checked.out << checked.err);
  CHECK(checked.out.find("1 of 2 results are sound") != std::string::npos);
  for (const char* fault : {"its agent is that of seed 0 in ", "its curve is that of seed 0 in ",
                            "its agent has the seed 0, the result 1"}) {
    CAPTURE(fault);
    CHECK(checked.out.find(fault) != std::string::npos);
  }
}

// What `check` says of one of the project's results in which some entries were changed.
std::string FaultsOf(const std::string& run, const std::map<std::string, Json>& changes) {
  const fs::path original = [&] {
    for (const auto& entry : fs::directory_iterator(kResults)) {
      const std::string name = entry.path().filename();
      if (name.starts_with(run)) return entry.path();
    }
    return fs::path();
  }();
  const TemporaryFolder folder;
  Json result = Json::parse(ReadBytes(original), nullptr, false);
  REQUIRE(result.is_object());
  for (const auto& [key, value] : changes) result[Json::json_pointer(key)] = value;
  WriteBytes(folder.File(original.filename()), result.dump());
  const Outcome outcome = Run({"benchmark", "check", folder.File(original.filename())});
  CHECK(outcome.exit_code == 1);
  CHECK(outcome.out.find("0 of 1 results are sound") != std::string::npos);
  return outcome.out;
}

TEST_CASE("What does not fit the rest of a result is named") {
  const auto says = [](const std::string& key, const Json& value, const std::string& words) {
    const std::string text = FaultsOf("HalfCheetah-iql-medium-s0-", {{key, value}});
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
  CHECK(says("/dataset/name", "HalfCheetah/medium",
             "dataset.name is 'HalfCheetah/medium', must be 'HalfCheetah/medium-v0'"));
  CHECK(says("/dataset/rows", 5'000'000,
             "dataset.rows is 5000000, allowed: at most the 1000000 of HalfCheetah/medium-v0"));
  CHECK(says("/scorings/served", Json::object(), "scorings has 'served', which such a run does"));
  CHECK(says("/scorings", "none", "scorings must be an object"));
  CHECK(says("/source", "a\nsound b\x1b[2J\xc2\x9b",
             "source is 'a\uFFFDsound b\uFFFD[2J\uFFFD', allowed: "));
  CHECK(says("/benchmarks/0", "HalfCheetah/clean/mediu", "is in no suite"));
  CHECK(says("/benchmarks/0", "HalfCheetah/clean/medium-expert", "fills no cell of benchmark"));
  CHECK(says("/suite", "v9", "suite is 'v9'"));
  CHECK(says("/benchmarks/1", "HalfCheetah/modelling-error/gravity+medium", "is listed twice"));
  CHECK(says("/selection", "best", "selection is 'best'"));
  CHECK(says("/source", "hearsay", "allowed: own, user, self-scored"));
  CHECK(says("/finished", false, "has not finished"));
  CHECK(says("/ledger", Json(), "ledger.dataset_rows"));
  CHECK(says("/environment", "HalfCheeta", "HalfCheetah"));
  CHECK(says("/corruption_seed", 5, "corruption_seed is 5, must be 0"));
  CHECK(says("/history", 7, "history is 7, must be 1"));
  CHECK(says("/transitions", "d4rl", "transitions is 'd4rl'"));
  CHECK(says("/seconds", -5, "seconds is -5, must be at least 0"));
  CHECK(says("/environment_steps", 7, "environment_steps is 7"));
  CHECK(says("/ledger/dataset_rows", 0, "iql learns from a dataset"));
  CHECK(says("/ledger/evaluation_episodes", 9, "fewer than the curve has"));
  CHECK(says("/curve/3/4", 99, "the score after 8000 updates is not that of its return"));
  CHECK(says("/curve/3/3", -1, "the standard deviation after 8000 updates is -1"));
  CHECK(says("/curve/49/3", 1e6, "the last standard deviation is 1000000"));
}

TEST_CASE("A run that says why it diverged need not have finished") {
  const auto faults = [](const std::string& reason) {
    return FaultsOf("HalfCheetah-iql-medium-s0-", {{"/diverged", reason},
                                                   {"/finished", false},
                                                   {"/planned_updates", 1'000'000},
                                                   {"/budget", "paper"},
                                                   {"/seconds", -5}});
  };
  const std::string sound = faults("loss became nan");
  INFO(sound);
  CHECK(std::ranges::count(sound, '\n') == 2);  // its seconds, and the count of sound results
  const std::string long_one = faults(std::string(1'001, 'x'));
  CHECK(long_one.find("diverged must be a text of 1 to 1000 bytes") != std::string::npos);
  CHECK(long_one.find("the run has not finished") != std::string::npos);
}

TEST_CASE("A result of a suite that was not given has no fault of its budget") {
  const std::string faults = FaultsOf("HalfCheetah-iql-medium-s0-",
                                      {{"/benchmarks", Json::array({"HalfCheetah/mine/medium"})}});
  INFO(faults);
  CHECK(faults.find("'HalfCheetah/mine/medium' is in no suite (--suites FOLDER for your own)") !=
        std::string::npos);
  CHECK(faults.find("budget is") == std::string::npos);
}

TEST_CASE("A further score that does not fit its returns, or its run, is named") {
  const auto says = [](const std::string& key, const Json& value, const std::string& words) {
    CHECK_THAT(
        FaultsOf("HalfCheetah-iql-medium+hidden-high-s0-", {{"/scorings/full" + key, value}}),
        Catch::Contains("scorings.full." + words));
  };
  says("/score", 999, "score is 999, which is not that of the returns");
  says("/score", Json(), "score is null");
  says("/return", 1, "return is 1, the returns make it ");
  says("/returns", Json::array(), "returns must be a list of numbers");
  says("/observe", "trained", "observe is 'trained', must be 'full'");
  says("/simulator", "gravity", "simulator is 'gravity', must be ''");
  says("/simulator", "gravity=x", "simulator is 'gravity=x'");
}

TEST_CASE("A learner's name that the runner would refuse is refused in results, too") {
  for (const char* name : {"iql ", "mine_too", "", "m\xc3\xa4in"}) {
    CAPTURE(name);
    CHECK_THAT(FaultsOf("HalfCheetah-iql-medium-s0-", {{"/algorithm", name}, {"/source", "user"}}),
               Catch::Contains("', allowed: 1 to 40 letters, digits and dashes"));
  }
}

TEST_CASE("A benchmark that is named a thousand times is one fault") {
  const Json copies(1'000, "HalfCheetah/clean/medium");
  const std::string faults = FaultsOf("HalfCheetah-iql-medium-s0-", {{"/benchmarks", copies}});
  CHECK(std::ranges::count(faults, '\n') == 2);  // and the count of sound results
}

TEST_CASE("A user's suite may name versions of datasets, and share runs with the project's") {
  Suite suite("td3-bc = 20");
  const std::string suites = suite.File("suites");
  fs::create_directory(suites);
  WriteBytes(suites + "/mine.toml",
             "version = \"mine\"\nenvironment = \"HalfCheetah\"\n"
             "[[challenge]]\nname = \"mine\"\ndatasets = [\"random-v0\"]\n");
  suite.pattern = "HalfCheetah/mine/random-v0";
  REQUIRE(Run(suite.Command({"--suites", suites})).exit_code == 0);
  const fs::path file = fs::directory_iterator(suite.Out() + "/results")->path();
  CHECK(std::string(file.filename()).starts_with("HalfCheetah-td3-bc-random-s0-"));
  const Json result = Json::parse(ReadBytes(file), nullptr, false);
  CHECK(std::ranges::count(result["benchmarks"], "HalfCheetah/clean/random") == 1);
  CHECK(std::ranges::count(result["benchmarks"], "HalfCheetah/mine/random-v0") == 1);
  const Outcome checked = Run({"benchmark", "check", suite.Out(), "--suites", suites});
  INFO(checked.out << checked.err);
  CHECK(checked.exit_code == 0);
}

TEST_CASE("Names of the project's budgets and recipes stand for what they say") {
  const auto says = [](const std::string& run, const std::map<std::string, Json>& changes,
                       const std::string& words) {
    CHECK_THAT(FaultsOf(run, changes), Catch::Contains(words));
  };
  const std::string iql = "HalfCheetah-iql-medium-s0-", mopo = "HalfCheetah-mopo-random-s0-";
  const std::string sac = "HalfCheetah-sac-gravity-s0-";
  says(iql, {{"/budget", "paper"}}, "updates is 100000, fewer than the 1000000 of the budget");
  says(iql, {{"/budget", "long-ensemble"}}, "budget is 'long-ensemble', which has no such run");
  says(iql, {{"/recipe", "short"}}, "recipe is 'short', the budget 'small' makes it ''");
  says(iql, {{"/dataset/rows", 10}, {"/dataset/columns_sha256", "00"}},
       "has other rows than the published ones");
  says(mopo, {{"/budget", "paper"}, {"/recipe", "paper"}},
       "budget is 'paper', in which mopo has other hyperparameters");
  says(mopo, {{"/budget", "mine"}, {"/recipe", "paper"}},
       "recipe is 'paper', which has other hyperparameters");
  // Its one hyperparameter is another than MOPO's.
  const std::string no_penalty = "HalfCheetah/controls/no-penalty+medium";
  says("HalfCheetah-mopo-medium-s0-48d70dbf", {{"/benchmarks/0", no_penalty}},
       "the run fills no cell of benchmark '" + no_penalty);
  says(sac, {{"/ledger/simulator_steps", 0}}, "sac learns from a simulator");
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

TEST_CASE("A file that is larger than a result can be is named and not read") {
  const TemporaryFolder folder;
  WriteBytes(folder.File("a.json"), "{}" + std::string(4 << 20, ' '));
  const Outcome outcome = Run({"benchmark", "check", folder.path()});
  CHECK(outcome.exit_code == 1);
  CHECK(outcome.out.find("a.json is longer than 4194304 bytes") != std::string::npos);
}

TEST_CASE("Nobody waits for the hash of a file that is larger than an agent can be") {
  const Suite suite("bc = 20");
  REQUIRE(Run(suite.Command()).exit_code == 0);
  // As long as its agent is missing, all other files are looked at.
  const fs::path run = fs::directory_iterator(suite.Out() + "/runs")->path();
  fs::rename(run / "agent.h5", run / "agent.kept");
  WriteBytes(run / "agent.h5", "");
  fs::resize_file(run / "agent.h5", uint64_t{300} << 30);  // takes no room on the disk
  const Outcome checked = Run({"benchmark", "check", suite.Out()});
  INFO(checked.out << checked.err);
  CHECK(checked.exit_code == 0);
  CHECK(checked.out.find("no agent is there") != std::string::npos);
  const Outcome evaluated = Run({"benchmark", "evaluate", run});
  CHECK(evaluated.exit_code == 1);
  CHECK(evaluated.out.find("has 322122547200 bytes, allowed: at most 2147483648") !=
        std::string::npos);
}

TEST_CASE("The leaderboard names the results of suites that it was not given") {
  const TemporaryFolder folder;
  WriteBytes(folder.File("a.json"),
             R"({"finished": true, "benchmarks": ["Hopper/mine/a"], "cell": "c", "seed": 0})");
  const Outcome outcome = Run({"benchmark", "leaderboard", folder.path()});
  CHECK(outcome.exit_code == 0);
  CHECK(outcome.err.find("left out: ") != std::string::npos);
  CHECK(outcome.err.find("'Hopper/mine/a' is in no suite (--suites") != std::string::npos);
}

TEST_CASE("A pipe in a result's place is named, and nothing waits for its writer") {
  const TemporaryFolder folder;
  REQUIRE(mkfifo(folder.File("a.json").c_str(), 0600) == 0);
  const Outcome outcome = Run({"benchmark", "check", folder.File("a.json")});
  CHECK(outcome.exit_code == 1);
  CHECK(outcome.out.find("a.json is no regular file") != std::string::npos);
}

TEST_CASE("Agents of a folder are evaluated once each, by however many programs") {
  const TemporaryFolder folder;
  const std::string agents = B4MRL_SOURCE_DIR "/data/agents/";
  for (const char* name : {"hopper-medium", "walker2d-medium", "highway-medium"}) {
    fs::copy_file(agents + name + ".h5", folder.File(std::string(name) + ".h5"));
  }
  fs::create_directories(folder.File("runs/one"));
  fs::copy_file(agents + "hopper-expert.h5", folder.File("runs/one/agent.h5"));
  fs::copy_file(agents + "hopper-medium.h5", folder.File("runs/agent.h5"));  // as the first
  WriteBytes(folder.File("broken.h5"), "no agent");
  const Words command = {"benchmark", "evaluate", folder.path(), "--episodes", "2", "--jobs", "2"};
  Tool one(command), other(command);
  const Outcome first = one.Wait(), second = other.Wait();
  INFO(first.out << first.err << second.out << second.err);
  for (const Outcome& outcome : {first, second}) {
    CHECK(outcome.exit_code == 1);  // for the broken file
    CHECK(outcome.out.find("4 of 5 agents evaluated, 1 failed") != std::string::npos);
  }
  CHECK(Count(first.err + second.err, "start ") == 4);
  size_t evaluations = 0;
  for (const auto& entry : fs::directory_iterator(folder.File("evaluations"))) {
    if (entry.path().extension() != ".json") continue;
    const auto json = nlohmann::json::parse(ReadBytes(entry.path()), nullptr, false);
    CHECK(json["returns"].size() == 2);
    CHECK(json["seed"] == 1);
    CHECK(entry.path().filename().string().find("-e2-s1.json") == 16);
    ++evaluations;
  }
  CHECK(evaluations == 4);
}

TEST_CASE(
    "An agent that is replaced while it is evaluated is evaluated again, as what it is then") {
  const TemporaryFolder folder;
  const std::string agents = B4MRL_SOURCE_DIR "/data/agents/";
  fs::copy_file(agents + "hopper-expert.h5", folder.File("agent.h5"));
  fs::copy_file(agents + "hopper-medium.h5", folder.File("next"));
  Tool tool({"benchmark", "evaluate", folder.path(), "--episodes", "50"});
  REQUIRE(tool.WaitForMessage("start "));
  fs::rename(folder.File("next"), folder.File("agent.h5"));
  const Outcome outcome = tool.Wait();
  INFO(outcome.out << outcome.err);
  CHECK(outcome.exit_code == 0);
  CHECK(Count(outcome.err, "start ") == 1);  // beside the one that was awaited
  std::vector<std::string> evaluations;
  for (const auto& entry : fs::directory_iterator(folder.File("evaluations"))) {
    if (entry.path().extension() == ".json") evaluations.push_back(entry.path());
  }
  REQUIRE(evaluations.size() == 1);
  const std::string hash = Take(Sha256OfFile(folder.File("agent.h5"))).substr(0, 16);
  CHECK(fs::path(evaluations[0]).filename().string() == hash + "-e50-s1.json");
  const Outcome direct = Run({"evaluate", "--json", "--environment", "Hopper", "--agent",
                              folder.File("agent.h5"), "--episodes", "50", "--seed", "1"});
  const auto kept = nlohmann::json::parse(ReadBytes(evaluations[0]), nullptr, false);
  const auto again = nlohmann::json::parse(direct.out, nullptr, false);
  REQUIRE(kept["returns"].size() == 50);
  CHECK(kept["returns"] == again["returns"]);
}

}  // namespace
}  // namespace b4mrl
