#include "benchmarks/evidence/differences.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <iterator>

#include "tests/benchmarks/evidence/made_results.h"

namespace b4mrl {
namespace {

TEST_CASE("Levels are mean differences from the paper, a run once") {
  const CellScores paper = PaperScores(OwnBenchmarks());
  CellScores ours;
  for (const char* error : {"gravity", "friction"}) {
    const std::string benchmark = std::string("HalfCheetah/modelling-error/") + error + "+medium";
    for (const char* algorithm : {"sac", "iql"}) {
      ours[{benchmark, algorithm}] = *Find(paper, benchmark, algorithm);
      ours[{benchmark, algorithm}].mean -= 4;
    }
  }
  ours[{"HalfCheetah/modelling-error/gravity+medium", "sac"}].mean += 10;
  ours[{"HalfCheetah/modelling-error/gravity+medium", "sac"}].settled = false;
  const auto levels = ScoreLevels(paper, ours, OwnBenchmarks());
  REQUIRE(levels.size() == 2);
  CHECK(levels[0].algorithm == "sac");
  CHECK(levels[0].runs == 2);
  CHECK(levels[0].lower == 1);
  CHECK(levels[0].difference == Approx(1));
  CHECK(levels[0].settled_runs == 1);
  CHECK(levels[0].settled_difference == Approx(-4));
  CHECK(levels[1].runs == 1);  // IQL uses no simulator
  CHECK(levels[1].difference == Approx(-4));
}

TEST_CASE("Scores on other rows than the published ones have no level and no deviation") {
  const CellScores paper = PaperScores(OwnBenchmarks());
  CellScores ours = paper;
  for (auto& [name, score] : ours) {
    score.mean += 20;
    score.has_other_rows = name.second != "iql";
  }
  const auto levels = ScoreLevels(paper, ours, OwnBenchmarks());
  REQUIRE(levels.size() == 1);
  CHECK(levels[0].algorithm == "iql");
  for (const Deviation& each : Deviations(paper, ours, OwnBenchmarks(), 15)) {
    CHECK(each.algorithm == "iql");
  }
}

TEST_CASE("Scores far from the paper's are listed once a run") {
  const CellScores paper = PaperScores(OwnBenchmarks());
  CellScores ours = paper;
  for (auto& [name, score] : ours) {
    if (name.second == "sac" && name.first.starts_with("HalfCheetah")) score.mean += 16;
    if (name.second == "td3") score.mean += 14;
    if (name.first == "HalfCheetah/modelling-error/gravity+medium" && name.second == "h2o") {
      score.mean += 20;
      score.settled = false;
    }
  }
  const auto far = Deviations(paper, ours, OwnBenchmarks(), 15);
  const auto of = [&](const std::string& algorithm) {
    std::vector<Deviation> found;
    std::ranges::copy_if(far, std::back_inserter(found),
                         [&](const Deviation& each) { return each.algorithm == algorithm; });
    return found;
  };
  CHECK(far.size() == 9);
  REQUIRE(of("sac").size() == 8);  // in eight simulators
  CHECK(of("sac").front().ours.mean - of("sac").front().paper == Approx(16));
  REQUIRE(of("h2o").size() == 1);
  CHECK_FALSE(of("h2o").front().ours.settled);
}

}  // namespace
}  // namespace b4mrl
