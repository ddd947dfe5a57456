// Seeds of one cell that were not trained alike: for more updates, evaluated otherwise, or until
// they diverged.
#include <algorithm>
#include <catch2/catch.hpp>
#include <optional>
#include <string>
#include <vector>

#include "benchmarks/evidence/score_table.h"
#include "tests/benchmarks/evidence/made_results.h"

namespace b4mrl {
namespace {

constexpr char kMedium[] = "HalfCheetah/modelling-error/gravity+medium";
constexpr char kClean[] = "HalfCheetah/clean/medium";

TEST_CASE("A seed that went on is read at the updates that all seeds of its cell have") {
  const MadeResults results({{.algorithm = "iql",
                              .benchmarks = {kClean, kMedium},
                              .score = 50,
                              .settled = false,
                              .updates = 2000},
                             {.algorithm = "iql",
                              .benchmarks = {kClean, kMedium},
                              .score = 40,
                              .seed = 1,
                              .cell = "iql" + std::string(kClean)}});
  const ScoreTable table = results.Read(OwnBenchmarks());
  const Cell& cell = *table.Find(kClean, {"iql", ""});
  CHECK(cell.Scores() == std::vector<double>{45, 40});
  CHECK(cell.MostUpdates() == 1000);
  CHECK(cell.runs[0]->further.empty());  // the scored agent is a later one
  REQUIRE(table.notes().size() == 1);
  CHECK_THAT(table.notes()[0], Catch::Contains("gone on to 2000 updates and is read at 1000"));
  // The run itself stays whole, for curves and core-hours.
  CHECK(table.runs()[0].updates == 2000);
  CHECK(table.runs()[0].fills_a_cell);
}

TEST_CASE("Seeds with other evaluations are read at the last that all of them have") {
  const std::string cell = "iql" + std::string(kClean);
  const MadeResults results(
      {{.algorithm = "iql", .benchmarks = {kClean}, .score = 50, .cell = cell},  // at 100, 200, ...
       {.algorithm = "iql",
        .benchmarks = {kClean},
        .score = 40,
        .seed = 1,
        .cell = cell,
        .updates = 750}});  // at 75, 150, ...
  const ScoreTable table = results.Read(OwnBenchmarks());
  CHECK(table.Find(kClean, {"iql", ""})->LeastUpdates() == 600);
  CHECK(table.Find(kClean, {"iql", ""})->MostUpdates() == 600);
  CHECK(table.Find(kClean, {"iql", ""})->runs.front()->is_part);
}

TEST_CASE("Seeds that were never evaluated alike are each read at their last evaluation") {
  // One after 100, 200, ..., one after 99, 198, ... and one after 98, 196, ...
  const std::string cell = "iql" + std::string(kClean);
  std::vector<MadeResult> made;
  for (const uint64_t seed : {0, 1, 2}) {
    made.push_back({.algorithm = "iql",
                    .benchmarks = {kClean},
                    .score = 50 + static_cast<double>(seed) / 10,
                    .seed = seed,
                    .cell = cell,
                    .settled = false,
                    .updates = 1000 - 10 * seed});
  }
  const MadeResults results(made);
  const ScoreTable table = results.Read(OwnBenchmarks());
  // The score rises by a point an evaluation, and within 980 updates the first two have nine.
  CHECK(table.Find(kClean, {"iql", ""})->Scores() == std::vector<double>{49, 49.1, 50.2});
  REQUIRE(table.notes().size() == 3);
  CHECK_THAT(table.notes()[0],
             Catch::Contains("gone on to 1000 updates and is read at 900, its last evaluation "
                             "within the 980 of the shortest seed"));
  CHECK_THAT(table.notes()[1], Catch::Contains("gone on to 990 updates and is read at 891, "));
  CHECK_THAT(table.notes()[2], Catch::Contains("is a mean over several numbers of updates"));
}

// A result whose training diverged after 400 of its 1,000 updates.
std::string Diverged(uint64_t seed) {
  nlohmann::ordered_json json =
      JsonOf({.algorithm = "iql", .benchmarks = {kClean}, .score = 10, .seed = seed});
  json["finished"] = false;
  json["diverged"] = "loss became nan";
  json["updates"] = 400;
  json["curve"].erase(json["curve"].begin() + 4, json["curve"].end());
  return json.dump();
}

TEST_CASE("A seed that diverged counts as it ended, beside the others at their own end") {
  MadeResults results({{.algorithm = "iql", .benchmarks = {kClean}, .score = 40},
                       {.algorithm = "iql", .benchmarks = {kClean}, .score = 41, .seed = 1}});
  results.Add(Diverged(2));
  const ScoreTable table = results.Read(OwnBenchmarks());
  const Cell& cell = *table.Find(kClean, {"iql", ""});
  CHECK(cell.Scores() == std::vector<double>{40, 41, 10});
  CHECK(cell.LeastUpdates() == 1000);
  CHECK(table.left_out().empty());
  REQUIRE(table.notes().size() == 2);
  CHECK_THAT(table.notes()[0],
             Catch::Contains("result-2.json diverged") && Catch::Contains("after 400 updates"));
  CHECK_THAT(table.notes()[1], Catch::Contains("several numbers of updates"));
  // Where all that counts came before, nothing of it is to be seen.
  const auto until_300 = [](const ScoredRun&) { return std::optional<uint64_t>(300); };
  CHECK(results.Read(OwnBenchmarks(), until_300).notes().empty());
}

TEST_CASE("A seed that diverged does not turn out those that are still being trained") {
  MadeResults results({});
  results.Add(Diverged(0));
  nlohmann::ordered_json going =
      JsonOf({.algorithm = "iql", .benchmarks = {kClean}, .score = 40, .seed = 1});
  going["finished"] = false;
  results.Add(going.dump());
  const ScoreTable table = results.Read(OwnBenchmarks());
  const Cell& cell = *table.Find(kClean, {"iql", ""});
  CHECK(cell.Scores() == std::vector<double>{10, 40});
  CHECK_FALSE(cell.IsSettled());
}

TEST_CASE("Seeds that all diverged are read at the updates that all of them have") {
  MadeResults results({});
  results.Add(Diverged(0));
  nlohmann::ordered_json later = JsonOf(
      {.algorithm = "iql", .benchmarks = {kClean}, .score = 40, .seed = 1, .settled = false});
  later["finished"] = false;
  later["diverged"] = "loss became nan";
  results.Add(later.dump());
  const ScoreTable table = results.Read(OwnBenchmarks());
  const Cell& cell = *table.Find(kClean, {"iql", ""});
  CHECK(cell.Scores() == std::vector<double>{10, 34});
  CHECK(cell.MostUpdates() == 400);
}

}  // namespace
}  // namespace b4mrl
