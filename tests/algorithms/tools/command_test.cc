// The command line as a user meets it: exit codes, what goes to stdout, and runs that are killed.
#include <fmt/format.h>

#include <catch2/catch.hpp>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <string>

#include "algorithms/base/checkpoint.h"
#include "algorithms/list.h"
#include "algorithms/run/run_result.h"
#include "data/d4rl/agent_file.h"
#include "tests/algorithms/tools/tool.h"
#include "tests/data/temporary_folder.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

Words SmallTraining(const std::string& folder) {
  return {"train",       "--algorithm",
          "sac",         "--environment",
          "HalfCheetah", "--simulator",
          "gravity",     "--updates",
          "60",          "--eval-every",
          "20",          "--eval-episodes",
          "1",           "--checkpoint-every",
          "20",          "--log-every",
          "10",          "--hidden-width",
          "16",          "--batch-size=32",
          "--warm-up",   "100",
          "--seed",      "2",
          "--out",       folder};
}

Words operator+(Words words, const Words& more) {
  words.insert(words.end(), more.begin(), more.end());
  return words;
}

}  // namespace

TEST_CASE("Bad usage ends with code 2 and names the nearest known thing") {
  const Outcome command = Run({"trin"});
  CHECK(command.exit_code == 2);
  CHECK(command.err.find("did you mean 'train'") != std::string::npos);
  CHECK(command.out.empty());
  const Outcome algorithm = Run({"train", "--algorithm", "td3bc", "--environment", "HalfCheetah"});
  CHECK(algorithm.exit_code == 2);
  CHECK(algorithm.err.find("did you mean 'td3-bc'") != std::string::npos);
  const Outcome parameter =
      Run({"train", "--algorithm", "sac", "--environment", "HalfCheetah", "--gama", "0.9"});
  CHECK(parameter.exit_code == 2);
  CHECK(parameter.err.find("did you mean '--gamma'") != std::string::npos);
  const Outcome option =
      Run({"train", "--algorithm", "sac", "--environment", "HalfCheetah", "--updats", "5"});
  CHECK(option.exit_code == 2);
  CHECK(option.err.find("did you mean '--updates'") != std::string::npos);
  const Outcome evaluate = Run({"evaluate", "--agnet", "x"});
  CHECK(evaluate.exit_code == 2);
  const Outcome make = Run({"dataset", "make", "HalfCheetah/medium", "--rovs=5"});
  CHECK(make.exit_code == 2);
  CHECK(make.err.find("did you mean '--rows'") != std::string::npos);
  CHECK(Run({"train", "--algorithm", "td3-bc", "--environment", "HalfCheetah"}).exit_code == 2);
  CHECK(Run({"evaluate"}).exit_code == 2);
  CHECK(Run({}).exit_code == 2);
}

TEST_CASE("Options that do not go together end with code 2, before anything is trained") {
  const TemporaryFolder folder;
  const auto usage = [&](const Words& words) {
    const Outcome outcome = Run(Words{"train", "--out", folder.File("run"), "--algorithm"} + words);
    CHECK(outcome.exit_code == 2);
    CHECK_FALSE(std::filesystem::exists(folder.File("run")));
    return outcome.err;
  };
  const Words cheetah = {"--environment", "HalfCheetah", "--dataset", "HalfCheetah/none"};
  CHECK(usage(Words{"h2o"} + cheetah + Words{"--real-ratio", "1"}).find("real-ratio") !=
        std::string::npos);
  CHECK(usage(Words{"mopo"} + cheetah + Words{"--ensemble-elites", "8"}).find("1..7") !=
        std::string::npos);
  CHECK(usage({"sac", "--environment", "HalfCheetah", "--stop-at-score", "nan"})
            .find("a finite number") != std::string::npos);
  CHECK(usage({"sac", "--environment", "Humanoid", "--history", "11"}).find("1..10") !=
        std::string::npos);
}

TEST_CASE("Bad input ends with code 3, no daemon with 4, a refusal with 5") {
  TemporaryFolder folder;
  WriteBytes(folder.File("agent.h5"), "no agent");
  CHECK(Run({"evaluate", "--agent", folder.File("agent.h5"), "--environment", "HalfCheetah"})
            .exit_code == 3);
  const Outcome nobody = Run({"status", "--endpoint", "ipc://" + folder.File("nobody")});
  CHECK(nobody.exit_code == 4);
  CHECK(nobody.err.find(folder.File("nobody")) != std::string::npos);
  CHECK(nobody.err.find("b4mrl serve") != std::string::npos);
  const Outcome refused = Run(
      {"train", "--algorithm", "sac", "--environment", "HalfCheeta", "--out", folder.File("run")});
  CHECK(refused.exit_code == 5);
  CHECK(refused.err.find("did you mean 'HalfCheetah'") != std::string::npos);
}

TEST_CASE("An agent is evaluated where it was trained, and elsewhere only when told to") {
  const Words evaluate = {
      "evaluate",      "--agent", B4MRL_SOURCE_DIR "/data/agents/halfcheetah-medium.h5",
      "--environment",
      "Walker2d",  // of the same sizes
      "--episodes",    "1"};
  const Outcome refused = Run(evaluate);
  CHECK(refused.exit_code == 3);
  CHECK(refused.err.find("HalfCheetah") != std::string::npos);
  CHECK(refused.err.find("Walker2d") != std::string::npos);
  CHECK(Run(evaluate + Words{"--anyway"}).exit_code == 0);
}

TEST_CASE("An agent is evaluated in the environment that its file names unless another is given") {
  const TemporaryFolder folder;
  const auto evaluate = [](const std::string& agent) {
    return Run({"evaluate", "--agent", agent, "--episodes", "1", "--json"});
  };
  const std::string medium = B4MRL_SOURCE_DIR "/data/agents/halfcheetah-medium.h5";
  const Outcome at_home = evaluate(medium);
  CHECK(at_home.exit_code == 0);
  CHECK(nlohmann::json::parse(at_home.out, nullptr, false)["environment"] == "HalfCheetah");
  Agent homeless = Take(ReadAgent(medium));
  homeless.provenance.environment.clear();
  RequireOk(WriteAgent(folder.File("homeless.h5"), homeless));
  const Outcome nowhere = evaluate(folder.File("homeless.h5"));
  CHECK(nowhere.exit_code == 2);
  CHECK(Says(nowhere.err, "--environment is ''"));
}

TEST_CASE("A run whose numbers are no longer finite has failed, with code 1") {
  const TemporaryFolder folder;
  Words words = SmallTraining(folder.File("run"));
  for (const char* word : {"--learning-rate", "1", "--updates", "300"}) words.emplace_back(word);
  const Outcome outcome = Run(words);
  INFO(outcome.err);
  CHECK(outcome.exit_code == 1);
  CHECK(ReadRunStatus(folder.File("run"))->state == RunState::kDiverged);
}

TEST_CASE("What a run needs and was not given is named") {
  const TemporaryFolder folder;
  const Outcome nothing = Run({"train", "--environment", "HalfCheetah"});
  CHECK(nothing.exit_code == 2);
  CHECK(nothing.err.find("--algorithm is missing") != std::string::npos);
  CHECK(nothing.err.find("hymopo") != std::string::npos);
  const Outcome no_data = Run({"train", "--algorithm", "bc", "--environment", "HalfCheetah"});
  CHECK(no_data.exit_code == 2);
  CHECK(Says(no_data.err, "--dataset is missing: bc learns from a dataset"));
  const Outcome data = Run({"train", "--algorithm", "sac", "--environment", "HalfCheetah",
                            "--dataset", "HalfCheetah/medium"});
  CHECK(data.exit_code == 2);
  CHECK(Says(data.err, "allowed: nothing, as sac learns in the simulator alone"));
  const Outcome nowhere = Run({"train", "--resume", "--out", folder.File("nowhere")});
  CHECK(nowhere.exit_code == 3);
  CHECK(nowhere.err.find("nowhere holds no run") != std::string::npos);
  CHECK_FALSE(std::filesystem::exists(folder.File("nowhere")));
}

TEST_CASE("Help and the version end with code 0") {
  const Outcome help = Run({"train", "--help"});
  CHECK(help.exit_code == 0);
  CHECK(help.out.find("hymopo") != std::string::npos);
  CHECK(help.out.find("above 1 with sac, td3 alone") != std::string::npos);
  CHECK(Run({"--version"}).exit_code == 0);
}

TEST_CASE(
    "The help of an algorithm lists its hyperparameters, those only, with default and source") {
  for (const Algorithm& algorithm : Algorithms()) {
    const Outcome help = Run({"train", "--algorithm", std::string(algorithm.name), "--help"});
    REQUIRE(help.exit_code == 0);
    std::set<std::string> own;
    for (const Hyperparameter& entry : algorithm.hyperparameters) {
      INFO(algorithm.name << " " << entry.name);
      own.emplace(entry.name);
      CHECK(help.out.find(fmt::format("  --{} {}", entry.name, entry.Text())) != std::string::npos);
      CHECK_FALSE(entry.source.empty());
      CHECK(help.out.find(entry.source) != std::string::npos);
    }
    for (const Algorithm& other : Algorithms()) {
      for (const Hyperparameter& entry : other.hyperparameters) {
        if (own.contains(std::string(entry.name))) continue;
        INFO(algorithm.name << " lists " << entry.name << " of " << other.name);
        CHECK(help.out.find(fmt::format("  --{} ", entry.name)) == std::string::npos);
      }
    }
  }
}

TEST_CASE("Defaults are shown as they hold in the environment") {
  const Outcome walker =
      Run({"train", "--algorithm", "mopo", "--environment", "Walker2d", "--help"});
  CHECK(walker.out.find("  --horizon 1 steps") != std::string::npos);
  const Outcome any = Run({"train", "--algorithm", "mopo", "--help"});
  CHECK(any.out.find("  --horizon 5 steps") != std::string::npos);
  CHECK(any.out.find("1 in Walker2d") != std::string::npos);
  const auto algorithms =
      nlohmann::json::parse(Run({"list", "algorithms", "--json"}).out, nullptr, false);
  size_t found = 0;
  for (const auto& algorithm : algorithms) {
    for (const auto& parameter : algorithm["hyperparameters"]) {
      const bool horizon = algorithm["name"] == "mopo" && parameter["name"] == "horizon";
      found += horizon ? 1 : 0;
      CHECK(parameter["default_by_environment"] ==
            (horizon ? nlohmann::json{{"Walker2d", 1.0}} : nlohmann::json::object()));
    }
  }
  CHECK(found == 1);
}

TEST_CASE("A training process that is killed and resumed ends like one that was not") {
  TemporaryFolder folder;
  const Outcome straight = Run(SmallTraining(folder.File("straight")));
  INFO(straight.err);
  REQUIRE(straight.exit_code == 0);
  {
    Tool killed(SmallTraining(folder.File("killed")));
    REQUIRE(killed.WaitForMessage("update 40:"));
    killed.Kill();
  }
  REQUIRE_FALSE(ListCheckpoints(folder.File("killed")).value().empty());
  const auto state = [&] { return ReadRunStatus(folder.File("killed"))->state; };
  CHECK(state() == RunState::kKilled);
  {
    const UniqueFd other = Take(LockRunFolder(folder.File("killed")));
    const Outcome busy = Run({"train", "--resume", "--out", folder.File("killed")});
    CHECK(busy.exit_code == 6);
    CHECK(Says(busy.err, "another process trains in"));
  }
  const Outcome resumed = Run({"train", "--resume", "--out", folder.File("killed"), "--json"});
  INFO(resumed.err);
  REQUIRE(resumed.exit_code == 0);
  const auto a = ReadAgent(folder.File("straight/agent.h5"));
  const auto b = ReadAgent(folder.File("killed/agent.h5"));
  REQUIRE(a.ok());
  REQUIRE(b.ok());
  CHECK(a->hidden[0].weight == b->hidden[0].weight);
  CHECK(a->last_fc.weight == b->last_fc.weight);
  // "... train --algorithm sac ...", not "... train --resume ...".
  CHECK(b->provenance.command.find("--algorithm sac") != std::string::npos);
  CHECK(resumed.err.find("so far: killed") != std::string::npos);
  CHECK(state() == RunState::kFinished);
  const auto json = nlohmann::json::parse(resumed.out, nullptr, false);
  REQUIRE(json.is_object());
  CHECK(json["updates"] == 60);
  CHECK(json["returns"].size() == 1);

  const Outcome changed = Run({"train", "--resume", "--out", folder.File("killed"), "--seed", "9"});
  CHECK(changed.exit_code == 3);
  CHECK(changed.err.find("--seed is '9'") != std::string::npos);
  const Outcome rounded =
      Run({"train", "--resume", "--out", folder.File("killed"), "--precision", "bf16"});
  CHECK(rounded.exit_code == 3);
  CHECK(rounded.err.find("--precision is 'bf16'") != std::string::npos);
}

TEST_CASE("Making a dataset replaces an existing one only when told to") {
  const TemporaryFolder folder;
  const Words make = {"dataset", "make", "HalfCheetah/medium", "--data", folder.File("data")};
  REQUIRE(Run(make + Words{"--rows", "1000"}).exit_code == 0);
  const std::string path = folder.File("data/HalfCheetah/medium-v0.h5");
  const std::string first = ReadBytes(path);
  const Outcome refused = Run(make + Words{"--rows", "2000"});
  CHECK(refused.exit_code == 3);
  CHECK(refused.err.find("--replace") != std::string::npos);
  CHECK(ReadBytes(path) == first);
  CHECK(Run(make + Words{"--rows", "2000", "--replace"}).exit_code == 0);
  CHECK(ReadBytes(path).size() > first.size());
}

TEST_CASE("A dataset survives export and import") {
  TemporaryFolder folder;
  const Words data = {"--data", folder.File("data")};
  REQUIRE(Run(Words{"dataset", "make", "HalfCheetah/medium", "--rows", "1500"} + data).exit_code ==
          0);
  REQUIRE(Run(Words{"dataset", "export", "HalfCheetah/medium", folder.File("out.h5")} + data)
              .exit_code == 0);
  REQUIRE(
      Run(Words{"dataset", "import", folder.File("out.h5"), "--name", "HalfCheetah/copy"} + data)
          .exit_code == 0);
  const auto info = [&](const std::string& name) {
    const Outcome outcome = Run(Words{"dataset", "info", name, "--json"} + data);
    REQUIRE(outcome.exit_code == 0);
    return nlohmann::json::parse(outcome.out, nullptr, false);
  };
  const auto original = info("HalfCheetah/medium"), copy = info("HalfCheetah/copy");
  for (const char* key : {"rows", "episodes", "mean_return", "observation_mean"}) {
    INFO(key);
    CHECK(original[key] == copy[key]);
  }
  WriteBytes(folder.File("bad.h5"), "no HDF5");
  CHECK(Run(Words{"dataset", "import", folder.File("bad.h5"), "--name", "HalfCheetah/bad"} + data)
            .exit_code == 3);
  CHECK_FALSE(std::filesystem::exists(folder.File("data/HalfCheetah/bad.h5")));
}

TEST_CASE("A run's config.toml names every option and repeats the run") {
  TemporaryFolder folder;
  const Outcome first = Run(SmallTraining(folder.File("first")));
  INFO(first.err);
  REQUIRE(first.exit_code == 0);
  const std::string text = ReadBytes(folder.File("first/config.toml"));
  const std::string configuration = folder.File("old.toml");
  WriteBytes(configuration, text + "eval-inline = true  # as earlier versions wrote\n");
  const Algorithm* sac = FindAlgorithm("sac").value();
  for (const Hyperparameter& entry : sac->hyperparameters) {
    INFO(entry.name);
    CHECK(text.find(fmt::format("\n{} = ", entry.name)) != std::string::npos);
  }
  const Outcome second = Run({"train", "--config", configuration, "--out", folder.File("second")});
  INFO(second.err);
  REQUIRE(second.exit_code == 0);
  CHECK(second.err.find("--eval-inline changes nothing") != std::string::npos);
  CHECK(ReadBytes(folder.File("second/config.toml")) == text);
  const auto record = [&](const std::string& run) {
    auto json = nlohmann::json::parse(ReadBytes(folder.File(run + "/run.json")), nullptr, false);
    json.erase("command");
    return json;
  };
  CHECK(record("first") == record("second"));
  const auto a = ReadAgent(folder.File("first/agent.h5"));
  const auto b = ReadAgent(folder.File("second/agent.h5"));
  REQUIRE((a.ok() && b.ok()));
  CHECK(a->last_fc.weight == b->last_fc.weight);
}

TEST_CASE("The log of the confounded decisions prefers the action that is worse") {
  // Each mean of n rewards in {0, 1} lies within five of its deviations, sqrt(p (1 - p) / n), but
  // for one seed in a million; the deviation itself is at most 1 / (2 sqrt(n)).
  const auto near = [](double mean, double truth, double count) {
    return std::abs(mean - truth) < 5 * std::sqrt(truth * (1 - truth) / count);
  };
  for (const char* seed : {"0", "1"}) {
    const Outcome outcome = Run({"demo", "confounding", "--json", "--seed", seed});
    REQUIRE(outcome.exit_code == 0);
    const auto json = nlohmann::json::parse(outcome.out, nullptr, false);
    REQUIRE(json.is_object());
    const double n = json["decisions"];
    CHECK(n == 1e6);
    const auto &a0 = json["actions"][0], &a1 = json["actions"][1];
    CHECK(near(a0["logged"].get<double>() / n, 2.0 / 3, n));
    CHECK(a0["logged"].get<double>() + a1["logged"].get<double>() == n);
    CHECK(near(a0["logged_reward"], 1.0 / 3, a0["logged"]));
    CHECK(near(a1["logged_reward"], 1.0 / 4, a1["logged"]));
    CHECK(near(a0["acting_reward"], 5.0 / 18, n));
    CHECK(near(a1["acting_reward"], 5.0 / 12, n));
    CHECK(json["best_in_the_log"] == "a0");
    CHECK(json["best"] == "a1");
  }
  const Outcome table = Run({"demo", "confounding", "--decisions", "1000"});
  CHECK(table.exit_code == 0);
  CHECK(table.out.find("5/12") != std::string::npos);
  CHECK(Run({"demo", "confounding", "--decisions", "0"}).exit_code == 2);
}

TEST_CASE("A configuration file gives options that the command line overrides") {
  TemporaryFolder folder;
  WriteBytes(folder.File("run.toml"),
             "algorithm = \"sac\"\nenvironment = \"HalfCheetah\"\nupdates = 20\n"
             "eval-episodes = 1\nwarm-up = 50\nhidden-width = 8\nbatch-size = 16\n"
             "gamma = 0.5\n");
  const Outcome outcome = Run({"train", "--config", folder.File("run.toml"), "--updates", "10",
                               "--out", folder.File("run"), "--json"});
  INFO(outcome.err);
  REQUIRE(outcome.exit_code == 0);
  CHECK(nlohmann::json::parse(outcome.out, nullptr, false)["updates"] == 10);
  const auto record = nlohmann::json::parse(ReadBytes(folder.File("run/run.json")), nullptr, false);
  CHECK(record["hyperparameters"]["gamma"] == 0.5);
  WriteBytes(folder.File("wrong.toml"),
             "algorithm = \"td3-bc\"\nenvironment = \"HalfCheetah\"\ndataset = \"x\"\n"
             "normalise = \"maybe\"\n");
  CHECK(Run({"train", "--config", folder.File("wrong.toml")}).exit_code == 2);
  for (const Words& second : {Words{"--config", "other.toml"}, Words{"--config=other.toml"}}) {
    const Outcome twice = Run(Words{"train", "--config", folder.File("run.toml")} + second);
    CHECK(twice.exit_code != 0);
    CHECK(twice.err.find("given twice") != std::string::npos);
  }
  WriteBytes(folder.File("bad.toml"), "updates = [1]\n");
  CHECK(Run({"train", "--config", folder.File("bad.toml")}).exit_code == 3);
}

}  // namespace b4mrl
