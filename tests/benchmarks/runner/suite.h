// Suites of a few short runs, for tests of `b4mrl benchmark`.
#pragma once

#include <catch2/catch.hpp>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/algorithms/tools/tool.h"

namespace b4mrl {

// A folder for a suite's runs, and a budget that trains bc and TD3-BC for a moment.
class Suite {
 public:
  explicit Suite(const std::string& updates = "td3-bc = 60, bc = 40") {
    WriteBytes(folder_.File("budget.toml"),
               "[tiny]\nevaluations = 2\nepisodes = 1\nrows = 2_000\n"
               "updates = { " +
                   updates + " }\n");
  }
  Words Command(const Words& more = {}) const {
    Words words = {"benchmark", "run", pattern, "--budget", folder_.File("budget.toml"),
                   "--out",     Out()};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }
  std::string pattern = "HalfCheetah/modelling-error/*+medium";
  std::string Out() const { return folder_.File("suite"); }
  std::string File(const std::string& name) const { return folder_.File(name); }

  // The runs' results by name, without what differs from one training to another: an agent's file
  // names the command line, with the folder.
  std::map<std::string, std::string> Results(bool with_agents = true) const {
    std::map<std::string, std::string> results;
    for (const auto& entry : std::filesystem::directory_iterator(Out() + "/results")) {
      auto json = nlohmann::json::parse(ReadBytes(entry.path()), nullptr, false);
      REQUIRE(json.is_object());
      if (with_agents) CHECK(json["agent_sha256"].get<std::string>().size() == 64);
      json.erase("agent_sha256");
      json.erase("seconds");
      // Batches are asked for ahead, so a run that was resumed has received some twice.
      if (json["source"] == "own" && json["ledger"].is_object())
        json["ledger"].erase("dataset_rows");
      results[entry.path().filename()] = json.dump();
    }
    return results;
  }

 private:
  TemporaryFolder folder_;
};

// A suite that two benchmarks fit, and a budget for learners of the user's own.
class UsersSuite {
 public:
  UsersSuite() {
    suite_.pattern = "HalfCheetah/confounding/hidden-*+medium";
    AskFor("70");
  }
  void AskFor(const std::string& updates) const {
    WriteBytes(suite_.File("budget.toml"),
               "[tiny]\nepisodes = 1\nrows = 2_000\nlearner-updates = " + updates +
                   "\nupdates = { bc = 20 }\n");
  }
  Outcome Train(const std::string& learner, const std::string& name = "mine",
                const Words& more = {}) const {
    Words words = {"--learner", learner, "--name", name};
    words.insert(words.end(), more.begin(), more.end());
    return Run(suite_.Command(words));
  }
  std::map<std::string, std::string> Results(bool with_agents = true) const {
    auto results = suite_.Results(with_agents);
    REQUIRE(results.size() >= 2);
    return results;
  }
  std::string File(const std::string& name) const { return suite_.File(name); }

 private:
  Suite suite_;
};

}  // namespace b4mrl
