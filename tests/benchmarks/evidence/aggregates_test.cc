#include "benchmarks/evidence/aggregates.h"

#include <catch2/catch.hpp>

#include "tests/benchmarks/evidence/made_results.h"

namespace b4mrl {
namespace {

// Two algorithms on so many benchmarks, the second one 10 points better.
std::vector<MadeResult> TwoAlgorithms(size_t benchmarks) {
  std::vector<MadeResult> made;
  for (size_t i = 0; i < benchmarks; ++i) {
    const std::string& name = OwnBenchmarks()[i].name;
    const auto score = static_cast<double>(10 * i);
    made.push_back({.algorithm = "iql", .benchmarks = {name}, .score = score});
    made.push_back({.algorithm = "hymopo", .benchmarks = {name}, .score = score + 10});
  }
  return made;
}

TEST_CASE("Algorithms with settled cells on eight benchmarks are compared over them") {
  const MadeResults results(TwoAlgorithms(8));
  const ScoreTable table = results.Read(OwnBenchmarks());
  const auto aggregates = AggregatesOf(table, PaperScores(OwnBenchmarks()));
  REQUIRE(aggregates);
  CHECK(aggregates->benchmarks.size() == 8);
  REQUIRE(aggregates->series.size() == 2);
  const Aggregate& iql = aggregates->series[0];
  CHECK(iql.iqm == 35);  // of 20, 30, 40, 50
  CHECK(iql.mean == 35);
  REQUIRE(iql.iqm_interval);
  CHECK(iql.iqm_interval->low < 35);
  CHECK(iql.iqm_interval->high > 35);
  CHECK(iql.paper_iqm.has_value());
  CHECK(iql.profile.front() == 7.0 / 8);  // above 0
  CHECK(iql.profile.back() == 0);         // above 100
  REQUIRE(aggregates->improvements.size() == 1);
  CHECK(aggregates->improvements[0].better.algorithm == "hymopo");
  CHECK(aggregates->improvements[0].probability == 1);
}

TEST_CASE("Algorithms that have settled elsewhere leave those that share benchmarks compared") {
  // Two that share few benchmarks with each other, or more than the three below do.
  const size_t end = GENERATE(23, 30);
  auto made = TwoAlgorithms(8);
  for (size_t i = 0; i < 8; ++i) {
    made.push_back({.algorithm = "bc", .benchmarks = {OwnBenchmarks()[i].name}, .score = 5});
  }
  for (size_t i = 10; i < 30; ++i) {
    const std::string& name = OwnBenchmarks()[i].name;
    const auto score = static_cast<double>(i);
    if (i < end) made.push_back({.algorithm = "mine", .benchmarks = {name}, .score = score});
    if (i + end >= 43) made.push_back({.algorithm = "yours", .benchmarks = {name}, .score = score});
  }
  const MadeResults results(made);
  const ScoreTable table = results.Read(OwnBenchmarks());
  const auto aggregates = AggregatesOf(table, PaperScores(OwnBenchmarks()));
  REQUIRE(aggregates);
  CHECK(aggregates->benchmarks.size() == 8);
  CHECK(aggregates->series.size() == 3);
}

TEST_CASE("A benchmark with more seeds than the others weighs no more than they do") {
  auto made = TwoAlgorithms(8);
  for (uint64_t seed = 1; seed < 20; ++seed) {
    made.push_back(
        {.algorithm = "iql", .benchmarks = {OwnBenchmarks()[0].name}, .score = 0, .seed = seed});
  }
  const MadeResults results(made);
  const ScoreTable table = results.Read(OwnBenchmarks());
  const auto aggregates = AggregatesOf(table, PaperScores(OwnBenchmarks()));
  REQUIRE(aggregates);
  CHECK(aggregates->series[0].series.algorithm == "iql");
  CHECK(aggregates->series[0].iqm == 35);  // pooled, nearly all of it would be zeros
}

TEST_CASE("An improvement counts runs, also where benchmarks differ in their number") {
  std::vector<MadeResult> made;
  for (size_t i = 0; i < 8; ++i) {
    const std::string& name = OwnBenchmarks()[i].name;
    made.push_back({.algorithm = "iql", .benchmarks = {name}, .score = 40});
    made.push_back({.algorithm = "td3-bc", .benchmarks = {name}, .score = 30});
  }
  const std::string& first = OwnBenchmarks()[0].name;
  made.push_back({.algorithm = "td3-bc", .benchmarks = {first}, .score = 44, .seed = 1});
  const MadeResults results(made);
  const ScoreTable table = results.Read(OwnBenchmarks());
  const auto aggregates = AggregatesOf(table, PaperScores(OwnBenchmarks()));
  REQUIRE(aggregates);
  REQUIRE(aggregates->improvements.size() == 1);
  const Improvement& improvement = aggregates->improvements[0];
  CHECK(improvement.better.algorithm == "iql");
  CHECK(improvement.probability == (0.5 + 7) / 8);
  // Above 40: of the first benchmark's runs one half, of the others' none.
  const auto& td3_bc = aggregates->series[aggregates->series[0].series.algorithm == "iql" ? 1 : 0];
  CHECK(td3_bc.profile[8] == 0.5 / 8);
}

TEST_CASE("Seven benchmarks, unsettled cells and cells of one run are not enough") {
  const CellScores paper = PaperScores(OwnBenchmarks());
  const MadeResults seven(TwoAlgorithms(7));
  CHECK_FALSE(AggregatesOf(seven.Read(OwnBenchmarks()), paper));
  auto made = TwoAlgorithms(8);
  made[3].settled = false;
  const MadeResults unsettled(made);
  CHECK_FALSE(AggregatesOf(unsettled.Read(OwnBenchmarks()), paper));
  std::vector<std::string> names;
  for (size_t i = 0; i < 8; ++i) names.push_back(OwnBenchmarks()[i].name);
  const MadeResults shared({{.algorithm = "iql", .benchmarks = names, .score = 1},
                            {.algorithm = "bc", .benchmarks = names, .score = 2}});
  CHECK_FALSE(AggregatesOf(shared.Read(OwnBenchmarks()), paper));
}

TEST_CASE("An algorithm with few cells does not keep the others from being compared") {
  auto made = TwoAlgorithms(9);
  made.push_back({.algorithm = "sac", .benchmarks = {OwnBenchmarks()[0].name}, .score = 5});
  const MadeResults results(made);
  const ScoreTable table = results.Read(OwnBenchmarks());
  const auto aggregates = AggregatesOf(table, PaperScores(OwnBenchmarks()));
  REQUIRE(aggregates);
  CHECK(aggregates->series.size() == 2);
  CHECK(aggregates->benchmarks.size() == 9);
}

TEST_CASE("An algorithm with many cells elsewhere does not keep the others from being compared") {
  auto made = TwoAlgorithms(8);
  for (size_t i = 8; i < 20; ++i) {
    made.push_back({.algorithm = "mine", .benchmarks = {OwnBenchmarks()[i].name}, .score = 5});
  }
  const MadeResults results(made);
  const ScoreTable table = results.Read(OwnBenchmarks());
  const auto aggregates = AggregatesOf(table, PaperScores(OwnBenchmarks()));
  REQUIRE(aggregates);
  CHECK(aggregates->series.size() == 2);
  CHECK(aggregates->benchmarks.size() == 8);
}

TEST_CASE("A run counts once, and a pair of runs, however many benchmarks they fill") {
  std::vector<std::string> shared;  // by one run of each of two algorithms
  std::vector<MadeResult> made;
  for (size_t i = 0; i < 12; ++i) {
    const std::string& name = OwnBenchmarks()[i].name;
    made.push_back({.algorithm = "sac", .benchmarks = {name}, .score = static_cast<double>(i)});
    if (i < 5) {
      shared.push_back(name);
    } else {
      made.push_back({.algorithm = "iql", .benchmarks = {name}, .score = 20});
      made.push_back({.algorithm = "td3-bc", .benchmarks = {name}, .score = 30});
    }
  }
  made.push_back({.algorithm = "iql", .benchmarks = shared, .score = 100});
  made.push_back({.algorithm = "td3-bc", .benchmarks = shared, .score = 0});
  const MadeResults results(made);
  const ScoreTable table = results.Read(OwnBenchmarks());
  const auto aggregates = AggregatesOf(table, PaperScores(OwnBenchmarks()));
  REQUIRE(aggregates);
  CHECK(aggregates->benchmarks.size() == 12);
  for (const Aggregate& each : aggregates->series) {
    const bool is_iql = each.series.algorithm == "iql";
    CHECK(each.cells == (each.series.algorithm == "sac" ? 12 : 8));
    if (is_iql) CHECK(each.mean == (100 + 7 * 20) / 8.0);
  }
  for (const Improvement& each : aggregates->improvements) {
    if (each.better.algorithm == "sac" || each.worse.algorithm == "sac") continue;
    CHECK(each.better.algorithm == "td3-bc");
    CHECK(each.probability == 7.0 / 8);
    CHECK(each.pairs == 8);
  }
}

TEST_CASE("One run that fills many benchmarks has no interval") {
  auto made = TwoAlgorithms(8);
  std::erase_if(made, [](const MadeResult& each) { return each.algorithm == "iql"; });
  std::vector<std::string> names;
  for (size_t i = 0; i < 8; ++i) names.push_back(OwnBenchmarks()[i].name);
  made.push_back({.algorithm = "sac", .benchmarks = names, .score = 35});
  const MadeResults results(made);
  const ScoreTable table = results.Read(OwnBenchmarks());
  const auto aggregates = AggregatesOf(table, PaperScores(OwnBenchmarks()));
  REQUIRE(aggregates);
  REQUIRE(aggregates->series.size() == 2);
  CHECK_FALSE(aggregates->series[0].iqm_interval);
  CHECK(aggregates->series[0].profile_intervals.empty());
  CHECK(aggregates->series[1].iqm_interval);
  REQUIRE(aggregates->improvements.size() == 1);
  CHECK_FALSE(aggregates->improvements[0].interval);
}

}  // namespace
}  // namespace b4mrl
