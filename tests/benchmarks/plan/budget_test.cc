// Budgets are read whole, and mistakes in them are refused by name.
#include "benchmarks/plan/budget.h"

#include <catch2/catch.hpp>

#include "tests/data/temporary_folder.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

TEST_CASE("The project's budgets can be read") {
  for (const char* name : {"smoke", "early", "small", "short-ensemble", "long-ensemble", "paper"}) {
    CAPTURE(name);
    CHECK(Take(ReadBudget(DefaultBudgetsFile(), name)).name == name);
  }
  const Budget smoke = Take(ReadBudget(DefaultBudgetsFile(), "smoke"));
  CHECK(smoke.rows == 10'000);
  CHECK(smoke.updates.size() == 8);
  const Budget paper = Take(ReadBudget(DefaultBudgetsFile(), "paper"));
  CHECK(paper.seeds == 3);
  CHECK(paper.RecipeOf("mopo") == "paper");
  CHECK(paper.RecipeOf("sac").empty());
  CHECK(paper.hyperparameters.empty());
}

TEST_CASE("All budgets of a file can be read at once") {
  std::vector<std::string> names;
  for (const Budget& budget : Take(ReadBudgets(DefaultBudgetsFile()))) names.push_back(budget.name);
  CHECK(names == std::vector<std::string>{"early", "long-ensemble", "longer", "paper",
                                          "short-ensemble", "small", "smoke", "stable-baselines",
                                          "whole-schedule"});
}

TEST_CASE("An algorithm has the budget's precision or its own") {
  const TemporaryFolder folder;
  WriteBytes(folder.File("mine.toml"),
             "[mine]\nprecision = \"bf16\"\nprecisions = { h2o = \"fp32\" }\n"
             "updates = { sac = 5, h2o = 5 }\n");
  const Budget mine = Take(ReadBudget(folder.File("mine.toml"), ""));
  CHECK(mine.PrecisionOf("sac") == "bf16");
  CHECK(mine.PrecisionOf("h2o") == "fp32");
}

TEST_CASE("Hyperparameters are numbers, true or false, and names of choices") {
  const TemporaryFolder folder;
  WriteBytes(folder.File("mine.toml"),
             "[mine]\nupdates = { iql = 5 }\n"
             "hyperparameters = { iql = { actor = \"gaussian\", learning-rate = 3e-4 } }\n"
             "exception = [{ hyperparameters = { normalise = true, batch-size = 1_000_000 } }]\n");
  const Budget mine = Take(ReadBudget(folder.File("mine.toml"), ""));
  CHECK(mine.hyperparameters.at("iql") ==
        HyperparameterValues{{"actor", "gaussian"}, {"learning-rate", "0.0003"}});
  REQUIRE(mine.exceptions.size() == 1);
  CHECK(mine.exceptions.front().hyperparameters ==
        HyperparameterValues{{"batch-size", "1000000"}, {"normalise", "true"}});
}

TEST_CASE("A dataset of an exception may be named with its environment and version") {
  const TemporaryFolder folder;
  for (const char* name : {"medium-expert", "HalfCheetah/medium-expert",
                           "HalfCheetah/medium-expert-v0", "d4rl/halfcheetah-medium-expert-v2"}) {
    CAPTURE(name);
    WriteBytes(folder.File("mine.toml"),
               "[mine]\nupdates = { bc = 5 }\n[[mine.exception]]\nupdates = 7\ndatasets = [\"" +
                   std::string(name) + "\"]\n");
    const Budget mine = Take(ReadBudget(folder.File("mine.toml"), "mine"));
    CHECK(mine.UpdatesOf("bc", "", "HalfCheetah/medium-expert") == 7);
    CHECK(mine.UpdatesOf("bc", "", "d4rl/halfcheetah-medium-expert-v2") == 7);
    CHECK(mine.UpdatesOf("bc", "", "HalfCheetah/medium") == 5);
  }
}

TEST_CASE("Mistakes in a budget are refused by name") {
  const TemporaryFolder folder;
  const auto refusal = [&](const std::string& text) {
    WriteBytes(folder.File("mine.toml"), text);
    const auto read = ReadBudget(folder.File("mine.toml"), "mine");
    REQUIRE_FALSE(read.ok());
    return read.status().message();
  };
  const std::string head = "[mine]\nupdates = { sac = 5 }\n";
  const auto says = [&](const std::string& text, const std::string& words) {
    const std::string message = refusal(text);
    CAPTURE(message);
    return message.find("mine.toml") != std::string::npos &&
           message.find(words) != std::string::npos;
  };
  CHECK(says("[mine", "line 1"));
  CHECK(says("[other]\nrows = 1", "'mine'"));
  CHECK(says("mine = 1", "'mine' must be a table"));
  CHECK(says("[mine]\nrows = 1", "mine: 'updates'"));
  CHECK(says("[mine]\nupdates = { sac = 0 }",
             "mine: 'updates.sac' must be an entry of a table of whole numbers"));
  CHECK(says(head + "row = 5", "rows"));
  CHECK(says(head + "precision = \"fp16\"", "bf16"));
  CHECK(says(head + "precisions = { sac = \"fp16\" }", "bf16"));
  CHECK(says(head + "recipes = \"short\"", "'recipes' must be a table of texts"));
  CHECK(says(head + "episodes = 1_000_000", "1..1024"));
  CHECK(says(head + "hyperparameters = { sac = { lanes = [1] } }",
             "mine.hyperparameters: 'sac.lanes'"));
  CHECK(says(head + "[[mine.exception]]\nsimulator = [\"gravity\"]", "simulators"));
}

}  // namespace
}  // namespace b4mrl
