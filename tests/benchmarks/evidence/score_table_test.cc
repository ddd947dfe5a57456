#include "benchmarks/evidence/score_table.h"

#include <catch2/catch.hpp>

#include "benchmarks/evidence/scores.h"
#include "tests/benchmarks/evidence/made_results.h"

namespace b4mrl {
namespace {

constexpr char kMedium[] = "HalfCheetah/modelling-error/gravity+medium";
constexpr char kClean[] = "HalfCheetah/clean/medium";

TEST_CASE("Runs that differ in their seed alone are one cell of all benchmarks that they name") {
  const MadeResults results(
      {{.algorithm = "iql", .benchmarks = {kClean, kMedium}, .score = 40},
       {.algorithm = "iql", .benchmarks = {kClean, kMedium}, .score = 44, .seed = 1}});
  const ScoreTable table = results.Read(OwnBenchmarks());
  for (const char* name : {kClean, kMedium}) {
    const Cell* cell = table.Find(name, {"iql", ""});
    REQUIRE(cell != nullptr);
    CHECK(cell->Mean() == 42);
    CHECK(cell->Deviation() == 2);
    CHECK(cell->IsSettled());
  }
  CHECK(table.benchmarks().size() == 2);
  CHECK(table.notes().empty());
}

TEST_CASE("Seeds fill one cell though their plans knew other benchmarks and recipes' names") {
  const MadeResults results(
      {{.algorithm = "mopo", .benchmarks = {kMedium}, .score = 40, .recipe = "paper", .cell = "c"},
       {.algorithm = "mopo",
        .benchmarks = {kClean, kMedium},
        .score = 44,
        .seed = 1,
        .cell = "c"}});
  const ScoreTable table = results.Read(OwnBenchmarks());
  CHECK(table.series() == std::vector<Series>{{"mopo", "paper"}});
  for (const char* name : {kClean, kMedium}) {
    REQUIRE(table.Find(name, {"mopo", "paper"}) != nullptr);
    CHECK(table.Find(name, {"mopo", "paper"})->Mean() == 42);
  }
  CHECK(table.notes().empty());
}

TEST_CASE("A cell has settled where no run's policy learns any more") {
  MadeResult made = {.algorithm = "iql", .benchmarks = {kMedium}, .score = 40, .settled = false};
  const auto course = [&](uint64_t learns_until) {
    nlohmann::ordered_json json = JsonOf(made);
    json["hyperparameters"] = {{"cosine-updates", learns_until}};
    MadeResults results({});
    results.Add(json.dump());
    const ScoreTable table = results.Read(OwnBenchmarks());
    const Cell* cell = table.Find(kMedium, {made.algorithm, ""});
    REQUIRE(cell != nullptr);
    return cell->CourseOfScore();
  };
  CHECK(course(made.updates) == Course::kSettled);
  CHECK(course(made.updates + 1) == Course::kRising);
  made.algorithm = "mine";
  made.source = "user";  // whose hyperparameters may have any names
  CHECK(course(made.updates) == Course::kRising);
}

TEST_CASE("Recipes are series of their own, and the budget's or the fullest is the main one") {
  const MadeResults results(
      {{.algorithm = "mopo", .benchmarks = {kMedium}, .score = 40, .recipe = "paper"},
       {.algorithm = "mopo", .benchmarks = {kMedium, kClean}, .score = 30, .recipe = "short"},
       {.algorithm = "mine", .benchmarks = {kMedium}, .score = 50},
       {.algorithm = "td3", .benchmarks = {kMedium}, .score = 20}});
  const ScoreTable table = results.Read(OwnBenchmarks());
  const std::vector<Series> expected = {
      {"td3", ""}, {"mopo", "paper"}, {"mopo", "short"}, {"mine", ""}};
  CHECK(table.series() == expected);
  CHECK(table.MainSeries("mopo") == Series{"mopo", "short"});
  CHECK_FALSE(table.MainSeries("h2o"));
  const auto main_by = [&](const std::string& recipe) {
    return results.Read(OwnBenchmarks(), {}, {{"mopo", recipe}}).MainSeries("mopo");
  };
  CHECK(main_by("paper") == Series{"mopo", "paper"});
  CHECK(main_by("long") == Series{"mopo", "short"});  // with which it never ran
  CHECK(DisplayName(Series{"mopo", "short"}) == "MOPO (short)");
  CHECK(DisplayName("mine") == "mine");
}

TEST_CASE("Runs on other data are a series of their own, however many there are") {
  const Series on_d4rl = {"iql", "D4RL's data", true}, on_others = {"iql", "other rows", true};
  MadeResults results({{.algorithm = "iql", .benchmarks = {kClean}, .score = 40, .cell = "c"}});
  for (const uint64_t seed : {0, 1}) {
    results.Add(
        JsonOf({.algorithm = "iql",
                .benchmarks = {kClean, kMedium},
                .score = 60 + static_cast<double>(seed),
                .seed = seed,
                .cell = "c",
                .rows = seed == 0 ? "bb" : "cc",
                .dataset = seed == 0 ? "HalfCheetah/medium-v0" : "d4rl/halfcheetah-medium-v2"})
            .dump());
  }
  const ScoreTable table = results.Read(OwnBenchmarks(), {}, {{"iql", ""}});
  CHECK(table.Find(kClean, {"iql", ""})->Mean() == 40);
  REQUIRE(table.Find(kClean, on_others) != nullptr);
  REQUIRE(table.Find(kClean, on_d4rl) != nullptr);
  CHECK(table.notes().empty());
  CHECK(DisplayName(on_d4rl) == "IQL (D4RL's data)");
  CHECK(DisplayName(Series{"mopo", "short, other rows", true}) == "MOPO (short, other rows)");
  // They stand in for nothing, and are no recipe that others are compared by.
  const CellScores scores = OwnScores(table, {});
  CHECK(scores.contains({kClean, "iql"}));
  CHECK_FALSE(scores.contains({kMedium, "iql"}));
  CHECK(OtherRecipes(table).empty());
}

TEST_CASE("Scores that their author measured are another algorithm's, by name") {
  const MadeResults results(
      {{.algorithm = "mine", .benchmarks = {kClean}, .score = 40, .source = "user"},
       {.algorithm = "mine",
        .benchmarks = {kClean},
        .score = 99,
        .seed = 1,
        .source = "self-scored"}});
  const ScoreTable table = results.Read(OwnBenchmarks());
  CHECK(table.Find(kClean, {"mine", ""})->Mean() == 40);
  CHECK(table.Find(kClean, {"mine (self-scored)", ""})->Mean() == 99);
}

TEST_CASE("Of one seed in two precisions that in fp32 counts, as in the leaderboard") {
  const MadeResults results(
      {{.algorithm = "iql", .benchmarks = {kClean}, .score = 20, .precision = "bf16"},
       {.algorithm = "iql", .benchmarks = {kClean}, .score = 40}});
  CHECK(results.Read(OwnBenchmarks()).Find(kClean, {"iql", ""})->Mean() == 40);
}

TEST_CASE(
    "A result on another version of the benchmark's dataset is left out, however far it came") {
  MadeResults results({{.algorithm = "iql", .benchmarks = {kClean}, .score = 40}});
  auto old = JsonOf({.algorithm = "iql",
                     .benchmarks = {kClean, kMedium},
                     .score = 60,
                     .cell = "old",
                     .updates = 9000});
  old["dataset"]["name"] = "HalfCheetah/medium-v7";
  results.Add(old.dump());
  const ScoreTable table = results.Read(OwnBenchmarks());
  CHECK(table.Find(kClean, {"iql", ""})->Mean() == 40);
  REQUIRE(table.notes().size() == 1);
  CHECK_THAT(table.notes()[0],
             Catch::Contains("result-1.json was left out: its dataset is HalfCheetah/medium-v7, "
                             "and HalfCheetah/clean/medium has HalfCheetah/medium"));
}

TEST_CASE("Results of a benchmark that meant another world before are not averaged but named") {
  MadeResult before = {.algorithm = "mine", .benchmarks = {kClean}, .score = 40, .cell = "c"};
  for (const char* key : {"simulator", "corruption", "world"}) {
    CAPTURE(key);
    MadeResults results({before});
    auto after =
        JsonOf({.algorithm = "mine", .benchmarks = {kClean}, .score = 60, .seed = 1, .cell = "c"});
    after[key] = "friction=2";
    results.Add(after.dump());
    const ScoreTable table = results.Read(OwnBenchmarks());
    CHECK(table.Find(kClean, {"mine", ""})->runs.size() == 1);
    REQUIRE(table.notes().size() == 1);
    CHECK_THAT(table.notes()[0], Catch::Contains("was left out"));
  }
}

TEST_CASE("Of several hyperparameters those with the most runs count, of copies the longest") {
  MadeResults results(
      {{.algorithm = "iql", .benchmarks = {kClean}, .score = 10, .cell = "a"},
       {.algorithm = "iql", .benchmarks = {kClean}, .score = 40, .cell = "b"},
       {.algorithm = "iql", .benchmarks = {kClean}, .score = 42, .seed = 1, .cell = "b"}});
  auto shorter = JsonOf({.algorithm = "iql", .benchmarks = {kClean}, .score = 70, .cell = "b"});
  shorter["curve"].erase(9);
  results.Add(shorter.dump());
  const ScoreTable table = results.Read(OwnBenchmarks());
  CHECK(table.Find(kClean, {"iql", ""})->Scores() == std::vector<double>{40, 42});
  REQUIRE(table.notes().size() == 2);
  CHECK_THAT(table.notes()[0], Catch::Contains("result-0.json was left out") &&
                                   Catch::Contains("other hyperparameters"));
  CHECK_THAT(table.notes()[1], Catch::Contains("result-3.json was left out: result-1.json"));
}

TEST_CASE("Scores without a scale and runs without an evaluation are named") {
  const MadeResults results({{.algorithm = "iql", .benchmarks = {kClean}, .score = 1e300},
                             {.algorithm = "mopo", .benchmarks = {kClean}, .score = 40}});
  const auto limit = [](const ScoredRun&) { return std::optional<uint64_t>(50); };
  const ScoreTable table = results.Read(OwnBenchmarks(), limit);
  CHECK(table.runs().empty());
  REQUIRE(table.notes().size() == 2);
  CHECK_THAT(table.notes()[0], Catch::Contains("scores beyond 1e+09"));
  CHECK_THAT(table.notes()[1], Catch::Contains("no evaluation within 50 updates"));
}

TEST_CASE("A file that is no result is named and the others are read") {
  MadeResults results({{.algorithm = "iql", .benchmarks = {kClean}, .score = 40}});
  results.Add("no JSON");
  results.Add("{}");
  results.Add(R"({"id": 1, "curve": [[1, 2]], "benchmarks": {}, "sessions": 5, "algorithm": "x"})");
  auto without_cell = JsonOf({.algorithm = "iql", .benchmarks = {kClean}, .score = 50, .seed = 1});
  without_cell.erase("cell");
  results.Add(without_cell.dump());
  auto without_score = JsonOf({.algorithm = "iql", .benchmarks = {kClean}, .score = 60, .seed = 2});
  without_score["curve"][9][4] = nullptr;
  results.Add(without_score.dump());
  const ScoreTable table = results.Read(OwnBenchmarks());
  CHECK(table.runs().size() == 1);
  REQUIRE(table.notes().size() == 5);
  CHECK_THAT(table.notes()[3], Catch::Contains("no result of a run"));
  CHECK_THAT(table.notes()[4], Catch::Contains("some of its evaluations have a score"));
}

TEST_CASE("A result that is another seed's under another number is no second seed") {
  const MadeResults results({{.algorithm = "iql", .benchmarks = {kClean}, .score = 40},
                             {.algorithm = "iql", .benchmarks = {kClean}, .score = 42, .seed = 1},
                             {.algorithm = "iql", .benchmarks = {kClean}, .score = 40, .seed = 2}});
  const ScoreTable table = results.Read(OwnBenchmarks());
  CHECK(table.Find(kClean, {"iql", ""})->Scores() == std::vector<double>{40, 42});
  REQUIRE(table.notes().size() == 1);
  CHECK_THAT(table.notes()[0], Catch::Contains("result-2.json was left out: its curve is that of "
                                               "seed 0 in result-0.json"));
}

TEST_CASE("Scores and returns of one cell are not averaged") {
  MadeResults results({{.algorithm = "iql", .benchmarks = {kClean}, .score = 40}});
  auto returns = JsonOf({.algorithm = "iql", .benchmarks = {kClean}, .score = 50, .seed = 1});
  for (auto& point : returns["curve"]) point[4] = nullptr;
  results.Add(returns.dump());
  const ScoreTable table = results.Read(OwnBenchmarks());
  CHECK(table.Find(kClean, {"iql", ""})->Scores() == std::vector<double>{40});
  REQUIRE(table.notes().size() == 1);
  CHECK_THAT(table.notes()[0], Catch::Contains("one has scores, the other returns"));
}

// A result whose training goes on, at 400 of its 1,000 updates.
std::string Unfinished(const MadeResult& made) {
  nlohmann::ordered_json json = JsonOf(made);
  json["finished"] = false;
  json["updates"] = 400;
  json["curve"].erase(json["curve"].begin() + 4, json["curve"].end());
  return json.dump();
}

TEST_CASE("Of two sets of hyperparameters with as many runs, that with a finished one counts") {
  MadeResults results({});
  results.Add(Unfinished({.algorithm = "iql", .benchmarks = {kClean}, .score = 10, .cell = "a"}));
  results.Add(
      JsonOf(MadeResult{.algorithm = "iql", .benchmarks = {kClean}, .score = 40, .cell = "b"})
          .dump());
  const ScoreTable table = results.Read(OwnBenchmarks());
  CHECK(table.Find(kClean, {"iql", ""})->Mean() == 40);
}

TEST_CASE("A run that still goes on has ended where all that counts of it is there") {
  MadeResults results({});
  results.Add(Unfinished({.algorithm = "iql", .benchmarks = {kClean}, .score = 10}));
  const auto ended_within = [&](uint64_t updates) {
    return results.Read(OwnBenchmarks(), [&](const ScoredRun&) { return std::optional(updates); })
        .runs()
        .at(0)
        .ended;
  };
  CHECK(ended_within(400));
  CHECK_FALSE(ended_within(401));
}

TEST_CASE("A seed that is still being trained waits outside of a cell that has a finished one") {
  MadeResults results({{.algorithm = "iql", .benchmarks = {kClean}, .score = 40}});
  results.Add(Unfinished({.algorithm = "iql", .benchmarks = {kClean}, .score = 10, .seed = 1}));
  const ScoreTable table = results.Read(OwnBenchmarks());
  const Cell& cell = *table.Find(kClean, table.series()[0]);
  REQUIRE(cell.runs.size() == 1);
  CHECK(cell.Mean() == 40);
  CHECK(cell.IsSettled());
  REQUIRE(table.notes().size() == 1);
  CHECK(table.notes()[0].find("it has not finished") != std::string::npos);
  CHECK(std::ranges::count(table.runs(), true, &ScoredRun::fills_a_cell) == 1);
}

TEST_CASE("Seeds that are all still being trained fill their cell, which has not settled") {
  MadeResults results({});
  for (const uint64_t seed : {0, 1}) {
    results.Add(Unfinished({.algorithm = "iql",
                            .benchmarks = {kClean},
                            .score = 10.0 + static_cast<double>(seed),
                            .seed = seed}));
  }
  const ScoreTable table = results.Read(OwnBenchmarks());
  const Cell& cell = *table.Find(kClean, table.series()[0]);
  CHECK(cell.runs.size() == 2);
  CHECK_FALSE(cell.IsSettled());
}

TEST_CASE("A cell has settled when the mean over its seeds has, though one of them moves") {
  MadeResults results({{.algorithm = "iql", .benchmarks = {kClean}, .score = 40},
                       {.algorithm = "iql", .benchmarks = {kClean}, .score = 41, .seed = 1}});
  // Its last two fifths are 2 points apart, so those of the mean are 2 / 3.
  results.Add(
      JsonOf(
          MadeResult{
              .algorithm = "iql", .benchmarks = {kClean}, .score = 42, .seed = 2, .settled = false})
          .dump());
  const ScoreTable table = results.Read(OwnBenchmarks());
  const Cell& cell = *table.Find(kClean, table.series()[0]);
  REQUIRE(cell.runs.size() == 3);
  CHECK(cell.IsSettled());
  const auto last_fifth = cell.MeanOf([](const ScoredRun& run) { return run.fifths.last; });
  CHECK(last_fifth.value() == Approx((40 + 41 + 41.5) / 3));
  const MadeResults moving(
      {{.algorithm = "iql", .benchmarks = {kClean}, .score = 40},
       {.algorithm = "iql", .benchmarks = {kClean}, .score = 41, .seed = 1, .settled = false},
       {.algorithm = "iql", .benchmarks = {kClean}, .score = 42, .seed = 2, .settled = false},
       {.algorithm = "iql", .benchmarks = {kClean}, .score = 43, .seed = 3, .settled = false}});
  const ScoreTable other = moving.Read(OwnBenchmarks());
  CHECK(other.Find(kClean, other.series()[0])->IsSettled());  // by 1.5 points exactly
}

TEST_CASE("A result of an unknown benchmark fills no cell, and a note says so") {
  const MadeResults results({{.algorithm = "iql", .benchmarks = {kClean}, .score = 40},
                             {.algorithm = "iql", .benchmarks = {"Ant/mine/x"}, .score = 40}});
  const ScoreTable table = results.Read(OwnBenchmarks());
  CHECK(table.runs().size() == 2);
  CHECK(std::ranges::count(table.runs(), true, &ScoredRun::fills_a_cell) == 1);
  REQUIRE(table.notes().size() == 1);
  CHECK(table.notes()[0].find("names no benchmark of these suites") != std::string::npos);
  CHECK(table.left_out().size() == 1);
}

TEST_CASE("Until a number of updates, a run counts as it was then") {
  const MadeResults results(
      {{.algorithm = "iql", .benchmarks = {kClean}, .score = 40, .settled = false}});
  const auto limit = [](const ScoredRun&) { return std::optional<uint64_t>(550); };
  const ScoreTable half = results.Read(OwnBenchmarks(), limit);
  REQUIRE(half.runs().size() == 1);
  CHECK(half.runs()[0].updates == 500);
  CHECK(half.runs()[0].score == 35);
  CHECK(half.runs()[0].further.empty());  // the agent that was scored otherwise is a later one
  const ScoreTable whole = results.Read(OwnBenchmarks());
  CHECK(whole.runs()[0].updates == 1000);
  const Cell& moving = *whole.Find(kClean, whole.series()[0]);
  CHECK(moving.CourseOfScore() == Course::kRising);
  const auto early = [](const ScoredRun&) { return std::optional<uint64_t>(100); };
  const ScoreTable once = results.Read(OwnBenchmarks(), early);
  CHECK(once.Find(kClean, once.series()[0])->CourseOfScore() == Course::kUntold);
  CHECK(whole.runs()[0].further.at("full") == 41);
}

TEST_CASE("A score that gets worse is falling, not rising") {
  const MadeResults results(
      {{.algorithm = "iql", .benchmarks = {kClean}, .score = 40, .settled = false, .rise = -1}});
  const ScoreTable table = results.Read(OwnBenchmarks());
  CHECK(table.Find(kClean, table.series()[0])->CourseOfScore() == Course::kFalling);
}

}  // namespace
}  // namespace b4mrl
