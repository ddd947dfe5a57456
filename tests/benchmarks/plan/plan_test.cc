// Plans: which distinct runs fill the cells of the project's benchmarks, and what their ids depend
// on.
#include "benchmarks/plan/plan.h"
#include "benchmarks/plan/perturbation_names.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <set>
#include <span>

#include "algorithms/list.h"
#include "benchmarks/plan/suite_plan.h"
#include "server/perturbations/list.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

using Names = std::vector<std::string>;

const Names kPaperAlgorithms = {"sac", "td3", "td3-bc", "iql", "mopo", "h2o", "hymopo"};
const Names kPaperChallenges = {"modelling-error", "partial-observability-simulator",
                                "partial-observability-dataset", "action-discrepancy",
                                "confounding"};

const pb::CatalogueReply& Presets() {
  static const pb::CatalogueReply catalogue = [] {
    pb::CatalogueReply made;
    for (const Preset& preset : PresetList()) {
      pb::PerturbationInfo* info = made.add_perturbations();
      info->set_name(std::string(preset.parametric));
      info->add_presets()->set_name(std::string(preset.name));
      info->mutable_presets(0)->set_environment(std::string(preset.environment));
      info->mutable_presets(0)->set_argument(std::string(preset.argument));
    }
    return made;
  }();
  return catalogue;
}

Budget PaperBudget() { return Take(ReadBudget(DefaultBudgetsFile(), "paper")); }

std::vector<Benchmark> OwnBenchmarks(const std::string& pattern) {
  std::vector<Benchmark> benchmarks = Take(ReadSuites({DefaultSuitesFolder()}));
  std::erase_if(benchmarks, [&](const Benchmark& b) { return !FitsPattern(b.name, pattern); });
  REQUIRE_FALSE(benchmarks.empty());
  return benchmarks;
}

Result<std::vector<PlannedRun>> Plan(const std::vector<Benchmark>& benchmarks, const Budget& budget,
                                     const PlanChoice& choice) {
  const PlanSources sources = {Algorithms(), &Presets(),
                               [](const std::string& name) -> Result<nlohmann::json> {
                                 return nlohmann::json{{"name", name}};
                               }};
  return MakePlan(benchmarks, budget, choice, sources);
}

std::vector<PlannedRun> PlanOf(const std::vector<Benchmark>& benchmarks) {
  return Take(Plan(benchmarks, PaperBudget(), {kPaperAlgorithms, {0}}));
}

TEST_CASE("The paper's 364 cells are 192 distinct runs a seed") {
  std::map<std::string, size_t> runs;  // by challenge, each planned alone
  std::vector<Benchmark> all;
  for (const std::string& challenge : kPaperChallenges) {
    const auto benchmarks = OwnBenchmarks("HalfCheetah/" + challenge + "/*");
    runs[challenge] = PlanOf(benchmarks).size();
    all.insert(all.end(), benchmarks.begin(), benchmarks.end());
  }
  CHECK(runs == std::map<std::string, size_t>{{"modelling-error", 32},
                                              {"partial-observability-simulator", 52},
                                              {"partial-observability-dataset", 22},
                                              {"action-discrepancy", 32},
                                              {"confounding", 82}});
  const auto whole = PlanOf(all);
  CHECK(whole.size() == 192);
  size_t cells = 0;
  std::set<std::string> ids, names;
  for (const PlannedRun& run : whole) {
    cells += run.benchmarks.size();
    ids.insert(run.id);
    names.insert(run.name);
  }
  CHECK(cells == 364);
  CHECK(ids.size() == 192);
  CHECK(names.size() == 192);
}

TEST_CASE("Every single hidden dimension takes 34 runs, four of which other tables have") {
  auto benchmarks = OwnBenchmarks("HalfCheetah/dimensions/*");
  CHECK(PlanOf(benchmarks).size() == 34);
  for (const std::string& challenge : kPaperChallenges) {
    const auto more = OwnBenchmarks("HalfCheetah/" + challenge + "/*");
    benchmarks.insert(benchmarks.end(), more.begin(), more.end());
  }
  CHECK(PlanOf(benchmarks).size() == 192 + 30);
}

TEST_CASE("What an algorithm does not use is dropped from its cells") {
  const auto runs = PlanOf(OwnBenchmarks("HalfCheetah/confounding/hidden-high+*"));
  for (const PlannedRun& run : runs) {
    CAPTURE(run.name);
    const bool online = run.algorithm == "sac" || run.algorithm == "td3";
    const bool hybrid = run.algorithm == "h2o" || run.algorithm == "hymopo";
    CHECK(run.simulator == (online || hybrid ? "gravity" : ""));
    CHECK(run.dataset.empty() == online);
    CHECK(run.corruption == (online ? "" : "hidden-high"));
    CHECK(run.benchmarks.size() == (online ? 4 : 1));
  }
}

TEST_CASE("Benchmarks have no cells for algorithms for which they are not defined") {
  const auto algorithms = [](const std::string& pattern) {
    std::set<std::string> found;
    for (const PlannedRun& run : PlanOf(OwnBenchmarks(pattern))) found.insert(run.algorithm);
    return found;
  };
  CHECK(algorithms("HalfCheetah/action-delay/action-delay+*").count("hymopo") == 0);
  CHECK(algorithms("HalfCheetah/action-delay/action-delay+*").size() == 6);
  CHECK(algorithms("HalfCheetah/action-delay/gravity+*").size() == 7);
  CHECK(algorithms("HalfCheetah/controls/no-penalty+*") == std::set<std::string>{"mopo"});
  CHECK(algorithms("Highway/simulators/*") == std::set<std::string>{"sac"});
  CHECK(algorithms("Highway/*").count("mopo") == 0);
}

TEST_CASE("Ids hang on what decides a run's numbers and on nothing else") {
  Benchmark benchmark = OwnBenchmarks("HalfCheetah/confounding/hidden-high+medium").front();
  const auto run_of = [](const Benchmark& of, const Budget& budget, uint64_t seed) {
    return Take(Plan({of}, budget, {{"hymopo"}, {seed}})).front();
  };
  const Budget budget = PaperBudget();
  const PlannedRun run = run_of(benchmark, budget, 0);
  CHECK(run.name == "HalfCheetah-hymopo-gravity-medium+hidden-high-s0");

  Budget other = budget;
  other.updates["hymopo"] = 7;
  other.evaluations = 3;
  CHECK(run_of(benchmark, other, 0).id == run.id);
  other.precision = "bf16";
  CHECK(run_of(benchmark, other, 0).id != run.id);
  CHECK(run_of(benchmark, other, 0).cell_id == run.cell_id);
  CHECK(run_of(benchmark, budget, 1).id != run.id);
  CHECK(run_of(benchmark, budget, 1).cell_id == run.cell_id);
  other = budget;
  other.rows = 10'000;  // of every dataset
  CHECK(run_of(benchmark, other, 0).cell_id != run.cell_id);
  other = budget;
  other.hyperparameters["hymopo"]["rollout-lag"] = "1";
  CHECK(run_of(benchmark, other, 0).cell_id != run.cell_id);
  other.hyperparameters["hymopo"]["rollout-lag"] = "0";  // the default
  other.hyperparameters["hymopo"]["holdout"] = "tail";
  CHECK(run_of(benchmark, other, 0).id == run.id);
  other.hyperparameters["hymopo"]["holdout"] = "permutation";
  CHECK(run_of(benchmark, other, 0).cell_id != run.cell_id);

  Benchmark same = benchmark;
  same.simulator = "gravity=2";
  same.corruption = "hidden=9";
  CHECK(run_of(same, budget, 0).id == run.id);
  for (const auto& [field, text] : {std::pair{&Benchmark::simulator, "gravity=3"},
                                    std::pair{&Benchmark::corruption, "hidden=8"},
                                    std::pair{&Benchmark::dataset, "HalfCheetah/random"},
                                    std::pair{&Benchmark::world, "action-delay=2"}}) {
    Benchmark changed = benchmark;
    changed.*field = text;
    CHECK(run_of(changed, budget, 0).cell_id != run.cell_id);
  }
}

TEST_CASE("A budget's exceptions fit what is left of a cell") {
  const Budget small = Take(ReadBudget(DefaultBudgetsFile(), "small"));
  const auto run_of = [&](const std::string& pattern, const std::string& algorithm) {
    return Take(Plan(OwnBenchmarks(pattern), small, {{algorithm}, {0}})).front();
  };
  CHECK(run_of("HalfCheetah/modelling-error/gravity+medium", "sac").updates == 1'000'000);
  CHECK(run_of("Hopper/modelling-error/leg+medium", "sac").updates == 250'000);
  const auto limit = [&](const std::string& pattern) {
    return run_of(pattern, "hymopo").hyperparameters.at("ensemble-max-updates");
  };
  CHECK(limit("HalfCheetah/modelling-error/gravity+medium") == "20000");
  CHECK(limit("HalfCheetah/modelling-error/gravity+medium-expert") == "40000");
  auto d4rl = OwnBenchmarks("HalfCheetah/modelling-error/gravity+medium-expert");
  d4rl.front().dataset = OfD4rl(d4rl.front().dataset);
  const PlannedRun run_of_d4rl = Take(Plan(d4rl, small, {{"hymopo"}, {0}})).front();
  CHECK(run_of_d4rl.hyperparameters.at("ensemble-max-updates") == "40000");
  for (const PlannedRun& run :
       Take(Plan(OwnBenchmarks("HalfCheetah/modelling-error/*"), small, {{}, {0}}))) {
    CHECK(run.algorithm != "h2o");
  }
}

TEST_CASE("A budget's exceptions fit, however they spell what is wrong, and none for nothing") {
  const auto benchmarks = OwnBenchmarks("HalfCheetah/confounding/hidden-high+medium");
  const auto updates_with = [&](const BudgetException& exception) {
    Budget budget = PaperBudget();
    budget.exceptions = {exception};
    budget.exceptions.front().updates = 9;
    return Take(Plan(benchmarks, budget, {{"hymopo"}, {0}})).front().updates;
  };
  CHECK(updates_with({.simulators = {"gravity"}}) == 9);
  CHECK(updates_with({.simulators = {"gravity=2"}}) == 9);
  CHECK(updates_with({.simulators = {"gravity=3"}}) != 9);
  Budget budget = PaperBudget();
  budget.exceptions = {{.simulators = {"gravty"}}};
  const Status refused = Plan(benchmarks, budget, {{"hymopo"}, {0}}).status();
  CHECK(refused.code() == StatusCode::kInvalidArgument);
  CHECK_THAT(refused.message(), Catch::Contains("gravty") && Catch::Contains("gravity"));
}

TEST_CASE("A learner of the user's own has one run for each benchmark that is defined for it") {
  const PlanSources sources = {Algorithms(), &Presets(),
                               [](const std::string& name) -> Result<nlohmann::json> {
                                 return nlohmann::json{{"name", name + "-v0"}, {"rows", 2'000'000}};
                               }};
  PlanChoice choice;
  choice.seeds = {3, 4};
  choice.learner = UsersLearner{"mine", "true"};
  const Budget small = Take(ReadBudget(DefaultBudgetsFile(), "small"));
  const auto runs =
      Take(MakePlan(OwnBenchmarks("HalfCheetah/confounding/*"), small, choice, sources));
  CHECK(runs.size() == 2 * 16);
  const auto found = std::ranges::find(
      runs, std::vector<std::string>{"HalfCheetah/confounding/hidden-high+medium-expert"},
      &PlannedRun::benchmarks);
  REQUIRE(found != runs.end());
  // As users' programs compute it: SHA-256 of {"algorithm":"mine","benchmark":"HalfCheetah/
  // confounding/hidden-high+medium-expert","rows":2000000,"seed":3,"suite":"v0"}.
  CHECK(found->id == "3c479c8b912bc39c");
  CHECK(found->cell_id == "c0288e4249f97ab8");
  CHECK(found->name == "HalfCheetah-mine-gravity-medium-expert+hidden-high-s3");
  CHECK(found->updates == 100'000);
  REQUIRE(found->scorings.size() == 2);
  CHECK(found->scorings[0].name == "trained");
  CHECK(found->scorings[0].simulator == "hidden=9");
  CHECK(found->scorings[1].name == "full");
  // Benchmarks that name their algorithms are not for others.
  CHECK(Take(MakePlan(OwnBenchmarks("HalfCheetah/controls/*"), small, choice, sources)).empty());
}

TEST_CASE("A budget shortens the datasets that have a recipe, and no imported one") {
  const PlanSources sources = {Algorithms(), &Presets(),
                               [](const std::string& name) -> Result<nlohmann::json> {
                                 return nlohmann::json{{"name", name}, {"rows", 2'000'000}};
                               }};
  Benchmark benchmark = OwnBenchmarks("HalfCheetah/clean/medium").front();
  Budget budget = PaperBudget();
  budget.rows = 10'000;
  const auto rows_of = [&](const std::string& dataset) {
    benchmark.dataset = dataset;
    return Take(MakePlan(std::span(&benchmark, 1), budget, {{"iql"}, {0}}, sources)).front().rows;
  };
  CHECK(rows_of("HalfCheetah/medium") == 10'000);
  CHECK(rows_of("d4rl/halfcheetah-medium-v2") == 2'000'000);
}

TEST_CASE("A user's learner is refused a name that says something else") {
  const auto refusal = [](const std::string& name, const Budget& budget) {
    PlanChoice choice;
    choice.learner = UsersLearner{name, "true"};
    return Plan({}, budget, choice).status().message();
  };
  Budget budget = Take(ReadBudget(DefaultBudgetsFile(), "small"));
  CHECK(refusal("td3-bc", budget).find("no algorithm of b4mrl has") != std::string::npos);
  CHECK(refusal("a/b", budget).find("letters") != std::string::npos);
  CHECK(refusal("", budget).find("letters") != std::string::npos);
  budget.learner_updates.reset();
  CHECK(refusal("mine", budget).find("learner-updates") != std::string::npos);
}

TEST_CASE("Unknown algorithms and hyperparameters are refused by name, in words and files") {
  const auto benchmarks = OwnBenchmarks("HalfCheetah/modelling-error/gravity+medium");
  CHECK(Plan(benchmarks, PaperBudget(), {{"sca"}, {0}}).status().code() ==
        StatusCode::kUnknownName);
  // A budget is a file: its names are no mistakes of the command line.
  Budget budget = PaperBudget();
  budget.updates["sca"] = 1;
  CHECK(Plan(benchmarks, budget, {{}, {0}}).status().code() == StatusCode::kInvalidArgument);
  budget = PaperBudget();
  budget.hyperparameters["iql"]["expectil"] = "1";
  CHECK(Plan(benchmarks, budget, {{}, {0}}).status().code() == StatusCode::kInvalidArgument);
  budget = PaperBudget();
  budget.hyperparameters["iql"]["actor"] = "1";
  CHECK_THAT(Plan(benchmarks, budget, {{}, {0}}).status().message(),
             Catch::Contains("deterministic") && Catch::Contains("gaussian"));
  budget = PaperBudget();
  budget.recipes["td3bc"] = "short";
  CHECK(Plan(benchmarks, budget, {{}, {0}}).status().code() == StatusCode::kInvalidArgument);
  budget = PaperBudget();
  budget.exceptions.push_back({.algorithms = {"td3bc"}});
  CHECK(Plan(benchmarks, budget, {{}, {0}}).status().code() == StatusCode::kInvalidArgument);
}

TEST_CASE("An algorithm that is asked for needs updates in the budget") {
  const auto benchmarks = OwnBenchmarks("HalfCheetah/modelling-error/gravity+medium");
  const Budget small = Take(ReadBudget(DefaultBudgetsFile(), "small"));
  const Status refused = Plan(benchmarks, small, {{"h2o"}, {0}}).status();
  CHECK(refused.code() == StatusCode::kInvalidArgument);
  CHECK(refused.message().find("the budget small gives it no updates") != std::string::npos);
}

TEST_CASE("A run has one name and one length, however its benchmarks spell what is wrong") {
  const Budget small = Take(ReadBudget(DefaultBudgetsFile(), "small"));
  for (const auto& [dimension, preset] :
       {std::pair{"HalfCheetah/dimensions/hidden=9", "HalfCheetah/simulators/hidden-high"},
        std::pair{"HalfCheetah/dimensions/hidden=9+medium-expert",
                  "HalfCheetah/confounding/hidden-high+medium-expert"}}) {
    CAPTURE(dimension);
    const PlanChoice choice = {{"sac", "td3-bc"}, {0}};
    const auto one = Take(Plan(OwnBenchmarks(dimension), small, choice));
    REQUIRE(one.size() == 1);
    const auto others = Take(Plan(OwnBenchmarks(preset), small, choice));
    const auto other = std::ranges::find(others, one[0].id, &PlannedRun::id);
    REQUIRE(other != others.end());
    CHECK(one[0].name == other->name);
    CHECK(one[0].updates == other->updates);
  }
  CHECK(Take(ByPresets("hidden=9,obs-noise=0.3", "HalfCheetah", Presets())) ==
        "hidden-high,obs-noise=0.3");
}

}  // namespace
}  // namespace b4mrl
