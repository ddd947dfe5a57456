#include "benchmarks/evidence/scores.h"

#include <catch2/catch.hpp>

#include "tests/benchmarks/evidence/made_results.h"

namespace b4mrl {
namespace {

constexpr char kClean[] = "HalfCheetah/clean/medium";

TEST_CASE("The paper's deviations between seeds, pooled over its distinct runs") {
  const CellScores paper = PaperScores(OwnBenchmarks());
  // The root of the mean square of the column std of the paper's tables, each run once, computed
  // with numpy; printed there with one digit.
  const std::map<std::string, double> expected = {{"sac", 4.7},   {"td3", 6.9},    {"h2o", 5.4},
                                                  {"mopo", 5.15}, {"hymopo", 2.6}, {"iql", 2.5},
                                                  {"td3-bc", 2.0}};
  for (const auto& [algorithm, deviation] : expected) {
    CAPTURE(algorithm);
    CHECK(PooledPaperDeviation(paper, "HalfCheetah", algorithm).value() ==
          Approx(deviation).margin(0.05));
  }
  CHECK_FALSE(PooledPaperDeviation(paper, "HalfCheetah", "bc"));
  CHECK(PooledPaperDeviation(paper, "Hopper", "sac").value() > 20);  // its seeds differ by more
}

TEST_CASE("From three seeds on an interval is that of Student's t") {
  const MadeResults results({{.algorithm = "iql", .benchmarks = {kClean}, .score = 40},
                             {.algorithm = "iql", .benchmarks = {kClean}, .score = 42, .seed = 1},
                             {.algorithm = "iql", .benchmarks = {kClean}, .score = 47, .seed = 2}});
  const ScoreTable table = results.Read(OwnBenchmarks());
  const BorrowedDeviations deviations(table, PaperScores(OwnBenchmarks()));
  const CellScore score = OwnScores(table, deviations).at({kClean, "iql"});
  CHECK_FALSE(score.is_borrowed);
  // scipy.stats.t.interval(0.95, 2, 43, scipy.stats.sem([40, 42, 47]))
  const Interval interval = score.Interval95().value();
  CHECK(interval.low == Approx(34.043).margin(0.001));
  CHECK(interval.high == Approx(51.957).margin(0.001));
}

TEST_CASE("A cell whose evaluations swing has settled, but not surely") {
  const auto score_of = [](double swing) {
    nlohmann::ordered_json json = JsonOf({.algorithm = "iql", .benchmarks = {kClean}, .score = 40});
    json["curve"][6][4] = 40 + swing;  // the two of the fifth before, whose mean stays
    json["curve"][7][4] = 40 - swing;
    MadeResults results({});
    results.Add(json.dump());
    const ScoreTable table = results.Read(OwnBenchmarks());
    const BorrowedDeviations deviations(table, PaperScores(OwnBenchmarks()));
    return OwnScores(table, deviations).at({kClean, "iql"});
  };
  CHECK(score_of(1.4).surely_settled);  // the error of a mean of two is the swing
  CHECK(score_of(1.6).settled);
  CHECK_FALSE(score_of(1.6).surely_settled);
}

TEST_CASE("Two cells of an algorithm can be read after equally many updates") {
  const char* medium = "HalfCheetah/confounding/hidden-high+medium";
  const MadeResults results({{.algorithm = "iql",
                              .benchmarks = {kClean},
                              .score = 50,
                              .settled = false,
                              .rise = 2,
                              .updates = 2000},
                             {.algorithm = "iql", .benchmarks = {medium}, .score = 30}});
  const ScoreTable table = results.Read(OwnBenchmarks());
  const BorrowedDeviations deviations(table, PaperScores(OwnBenchmarks()));
  const CellScores scores = OwnScores(table, deviations);
  const CellScore& longer = scores.at({kClean, "iql"});
  CHECK(longer.mean == 50);
  const auto [clean, hidden] = AtEqualUpdates(longer, scores.at({medium, "iql"})).value();
  CHECK(clean.mean == 40);
  CHECK(clean.updates == 1000);
  CHECK_FALSE(clean.settled);
  CHECK(clean.standard_error == longer.standard_error);
  CHECK(hidden.mean == 30);
  CHECK(AtEqualUpdates(scores.at({medium, "iql"}), longer).value().second.mean == 40);
}

TEST_CASE("Where the longer run was evaluated too late, two cells cannot be read alike") {
  const char* medium = "HalfCheetah/confounding/hidden-high+medium";
  const MadeResults results(
      {{.algorithm = "iql", .benchmarks = {kClean}, .score = 50, .updates = 20'000},
       {.algorithm = "iql", .benchmarks = {medium}, .score = 30}});
  const ScoreTable table = results.Read(OwnBenchmarks());
  const BorrowedDeviations deviations(table, PaperScores(OwnBenchmarks()));
  const CellScores scores = OwnScores(table, deviations);
  CHECK_FALSE(AtEqualUpdates(scores.at({kClean, "iql"}), scores.at({medium, "iql"})));
}

TEST_CASE("Where the main recipe has no result, another stands for the algorithm") {
  const char* other = "HalfCheetah/controls/no-penalty+medium";
  const MadeResults results(
      {{.algorithm = "mopo", .benchmarks = {kClean}, .score = 50, .recipe = "long"},
       {.algorithm = "mopo", .benchmarks = {kClean}, .score = 20, .recipe = "short"},
       {.algorithm = "mopo", .benchmarks = {other}, .score = 10, .recipe = "short"}});
  const ScoreTable table = results.Read(OwnBenchmarks(), {}, {{"mopo", "long"}});
  const BorrowedDeviations deviations(table, PaperScores(OwnBenchmarks()));
  const CellScores scores = OwnScores(table, deviations);
  CHECK(scores.at({kClean, "mopo"}).mean == 50);
  CHECK(scores.at({other, "mopo"}).mean == 10);
  CHECK(scores.at({other, "mopo"}).recipe == "short");
  CHECK(OwnScores(table, deviations, "short").at({kClean, "mopo"}).mean == 20);
}

TEST_CASE("A ledger says which algorithms have used one source alone") {
  MadeResults results(std::vector{MadeResult{.algorithm = "both", .benchmarks = {kClean}}});
  nlohmann::ordered_json cloned = JsonOf(MadeResult{.algorithm = "cloned", .benchmarks = {kClean}});
  cloned["ledger"] = {{"simulator_steps", 0}, {"query_rows", 0}, {"dataset_rows", 3}};
  results.Add(cloned.dump());
  cloned["algorithm"] = "untold";
  cloned["cell"] = "untold";
  cloned.erase("ledger");
  results.Add(cloned.dump());
  const ScoreTable table = results.Read(OwnBenchmarks());
  const CellScores scores = OwnScores(table, BorrowedDeviations());
  CHECK(scores.at({kClean, "cloned"}).has_one_source);
  CHECK_FALSE(scores.at({kClean, "both"}).has_one_source);
  CHECK_FALSE(scores.at({kClean, "untold"}).has_one_source);
}

TEST_CASE("Below three seeds the deviation is borrowed, and of unknown algorithms there is none") {
  const MadeResults results({{.algorithm = "iql", .benchmarks = {kClean}, .score = 40},
                             {.algorithm = "bc", .benchmarks = {kClean}, .score = 40},
                             {.algorithm = "mine", .benchmarks = {kClean}, .score = 40}});
  const ScoreTable table = results.Read(OwnBenchmarks());
  const CellScores paper = PaperScores(OwnBenchmarks());
  const CellScores ours = OwnScores(table, BorrowedDeviations(table, paper));
  const CellScore& iql = ours.at({kClean, "iql"});
  CHECK(iql.is_borrowed);
  CHECK(iql.Interval95()->high ==
        Approx(40 + 1.959964 * PooledPaperDeviation(paper, "HalfCheetah", "iql").value())
            .margin(1e-4));
  CHECK(ours.at({kClean, "bc"}).standard_error ==
        PooledPaperDeviation(paper, "HalfCheetah", "td3-bc").value());
  CHECK_FALSE(ours.at({kClean, "mine"}).Interval95());
}

TEST_CASE("Ten cells with three seeds lend their own deviation") {
  std::vector<MadeResult> made;
  for (int cell = 0; cell < 10; ++cell) {
    for (uint64_t seed = 0; seed < 3; ++seed) {
      made.push_back({.algorithm = "iql",
                      .benchmarks = {OwnBenchmarks()[static_cast<size_t>(cell)].name},
                      .score = static_cast<double>(seed),
                      .seed = seed});
    }
  }
  made.push_back({.algorithm = "iql", .benchmarks = {kClean}, .score = 40});
  const MadeResults results(made);
  const ScoreTable table = results.Read(OwnBenchmarks());
  const BorrowedDeviations deviations(table, PaperScores(OwnBenchmarks()));
  CHECK(deviations.Of("HalfCheetah", {"iql", ""}).value() == Approx(1));  // of 0, 1, 2
}

TEST_CASE("Online runs are shared by datasets, offline runs by simulators") {
  const auto shared = [](const char* one, const char* other, const char* algorithm) {
    std::vector<std::string> runs;
    for (const Benchmark& benchmark : OwnBenchmarks()) {
      if (benchmark.name == one || benchmark.name == other) {
        runs.push_back(SharedRun(benchmark, algorithm));
      }
    }
    REQUIRE(runs.size() == 2);
    return runs[0] == runs[1];
  };
  const char* gravity = "HalfCheetah/modelling-error/gravity+medium";
  const char* friction = "HalfCheetah/modelling-error/friction+medium";
  const char* random = "HalfCheetah/modelling-error/gravity+random";
  CHECK(shared(gravity, random, "sac"));
  CHECK_FALSE(shared(gravity, friction, "sac"));
  CHECK(shared(gravity, friction, "iql"));
  CHECK_FALSE(shared(gravity, random, "iql"));
  CHECK_FALSE(shared(gravity, friction, "hymopo"));
  CHECK_FALSE(shared(gravity, friction, "mine"));  // nobody knows what it uses
}

}  // namespace
}  // namespace b4mrl
