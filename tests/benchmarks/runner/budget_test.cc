// Budgets are read whole, and mistakes in them are refused by name.
#include "benchmarks/runner/budget.h"

#include <catch2/catch.hpp>

#include "tests/data/temporary_folder.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

TEST_CASE("The project's budgets can be read") {
  for (const char* name : {"smoke", "small", "paper"}) {
    CAPTURE(name);
    CHECK(Take(ReadBudget(DefaultBudgetsFile(), name)).name == name);
  }
  const Budget smoke = Take(ReadBudget(DefaultBudgetsFile(), "smoke"));
  CHECK(smoke.rows == 10'000);
  CHECK(smoke.updates.size() == 8);
  const Budget paper = Take(ReadBudget(DefaultBudgetsFile(), "paper"));
  CHECK(paper.seeds == 3);
  CHECK(paper.hyperparameters.empty());
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
  CHECK(says("[mine]\nrows = 1", "mine.updates"));
  CHECK(says("[mine]\nupdates = { sac = 0 }", "mine.updates.sac must be a whole number"));
  CHECK(says(head + "row = 5", "rows"));
  CHECK(says(head + "precision = \"fp16\"", "bf16"));
  CHECK(says(head + "episodes = 1_000_000", "at most 10000"));
  CHECK(says(head + "hyperparameters = { sac = { lanes = \"x\" } }",
             "mine.hyperparameters.sac.lanes"));
  CHECK(says(head + "[[mine.exception]]\nsimulator = [\"gravity\"]", "simulators"));
}

}  // namespace
}  // namespace b4mrl
