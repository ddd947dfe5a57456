// Which series the run of a result is of, whatever its file says of itself.
#include "benchmarks/evidence/scored_run.h"

#include <catch2/catch.hpp>
#include <string>

#include "benchmarks/evidence/scores.h"
#include "tests/benchmarks/evidence/made_results.h"

namespace b4mrl {
namespace {

constexpr char kMedium[] = "HalfCheetah/modelling-error/gravity+medium";
constexpr char kClean[] = "HalfCheetah/clean/medium";

TEST_CASE(
    "A user's learner that is called like an algorithm of the project displaces no run of it") {
  for (const char* name : {"td3-bc", "TD3-BC"}) {
    CAPTURE(name);
    const MadeResults results(
        {{.algorithm = "td3-bc", .benchmarks = {kClean}, .score = 40},
         {.algorithm = name, .benchmarks = {kClean}, .score = 90, .seed = 0, .source = "user"},
         {.algorithm = name, .benchmarks = {kClean}, .score = 91, .seed = 1, .source = "user"}});
    const ScoreTable table = results.Read(OwnBenchmarks());
    CHECK(table.Find(kClean, {"td3-bc", ""})->Mean() == 40);
    REQUIRE(table.Find(kClean, {name + std::string(" (user)"), ""}) != nullptr);
    CHECK(table.Find(kClean, {name + std::string(" (user)"), ""})->Mean() == 90.5);
    CHECK(table.notes().empty());
  }
}

TEST_CASE("Control characters of a name reach no table and no note") {
  const std::string name = "my\x1b[2J\nown";
  const MadeResults results(
      {{.algorithm = name, .benchmarks = {kClean}, .score = 40},
       {.algorithm = name, .benchmarks = {kClean}, .score = 41, .seed = 1, .precision = "bf16"}});
  const ScoreTable table = results.Read(OwnBenchmarks());
  REQUIRE(table.series().size() == 1);
  CHECK(table.series()[0].algorithm == "my\uFFFD[2J\uFFFDown");
  REQUIRE(table.notes().size() == 1);
  CHECK_THAT(table.notes()[0], Catch::StartsWith("my\uFFFD[2J\uFFFDown on "));
}

TEST_CASE("Runs on other rows are not held against the paper's, those on D4RL's files are") {
  const auto is_comparable = [](const char* dataset) {
    const MadeResults results({{.algorithm = "iql",
                                .benchmarks = {kMedium},
                                .score = 40,
                                .rows = "bb",
                                .dataset = dataset}});
    const CellScores scores = OwnScores(results.Read(OwnBenchmarks()), {});
    REQUIRE(Find(scores, kMedium, "iql") != nullptr);
    return FindComparable(scores, kMedium, "iql") != nullptr;
  };
  CHECK_FALSE(is_comparable("HalfCheetah/medium-v0"));
  CHECK(is_comparable("d4rl/halfcheetah-medium-v2"));
  CHECK(is_comparable("mine/medium"));  // of which nothing is published
}

}  // namespace
}  // namespace b4mrl
