#include "benchmarks/records/budget_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <set>
#include <utility>

#include "benchmarks/records/json_file.h"
#include "benchmarks/records/result_file.h"

namespace b4mrl {
namespace {

using Json = nlohmann::ordered_json;

// The run that the budget has for the result's benchmarks and rows; nothing: it has none.
std::optional<PlannedRun> PlannedBy(Budget budget, const Json& result,
                                    const CheckSources& sources) {
  budget.rows = CountOf(EntryOf(result, "dataset"), "rows");
  const PlanChoice choice = {.algorithms = {TextOf(result, "algorithm")},
                             .seeds = {CountOf(result, "seed").value_or(0)}};
  std::set<std::string> tried;  // a file may name one as often as it likes
  for (const std::string& name : TextsOf(result, "benchmarks")) {
    const auto found = std::ranges::find(sources.benchmarks, name, &Benchmark::name);
    if (found == sources.benchmarks.end() || !tried.insert(name).second) continue;
    std::vector<Benchmark> benchmark = {*found};
    // D4RL's dataset of the same level may stand for the benchmark's.
    benchmark.front().dataset = DatasetName(result);
    const auto plan = MakePlan(benchmark, budget, choice, PlanSourcesFor(result, sources));
    if (plan.ok() && !plan->empty()) return plan->front();
  }
  return std::nullopt;
}

// Whether one of the result's benchmarks is in a suite; none is where the suite was not given.
bool HasKnownBenchmark(const Json& result, const CheckSources& sources) {
  return std::ranges::any_of(TextsOf(result, "benchmarks"), [&](const std::string& name) {
    return std::ranges::find(sources.benchmarks, name, &Benchmark::name) !=
           sources.benchmarks.end();
  });
}

// Of a result that names this budget.
std::vector<std::string> FaultsBeside(const Budget& budget,
                                      const std::optional<PlannedRun>& planned,
                                      const Json& result) {
  const std::string algorithm = TextOf(result, "algorithm");
  if (!planned) {
    return {fmt::format("budget is '{}', which has no such run of {}", budget.name, algorithm)};
  }
  std::vector<std::string> faults;
  if (TextOf(result, "cell") != planned->cell_id) {
    faults.push_back(fmt::format("budget is '{}', in which {} has other hyperparameters",
                                 budget.name, algorithm));
  }
  for (const auto& [key, must_be] :
       {std::pair{"recipe", &planned->recipe}, std::pair{"precision", &planned->precision}}) {
    const std::string text = TextOf(result, key);
    if (text == *must_be) continue;
    faults.push_back(
        fmt::format("{} is '{}', the budget '{}' makes it '{}'", key, text, budget.name, *must_be));
  }
  const auto updates = CountOf(result, "updates");
  if (updates && *updates < planned->updates && !HasDiverged(result)) {
    faults.push_back(fmt::format("updates is {}, fewer than the {} of the budget '{}'", *updates,
                                 planned->updates, budget.name));
  }
  return faults;
}

}  // namespace

std::vector<std::string> BudgetFaults(const Json& result, const CheckSources& sources) {
  if (TextOf(result, "source") != "own" || !HasKnownBenchmark(result, sources)) return {};
  const std::string recipe = TextOf(result, "recipe");
  bool is_known_recipe = false, is_recipe = false;
  for (const Budget& budget : sources.budgets) {
    const std::optional<PlannedRun> planned = PlannedBy(budget, result, sources);
    if (budget.name == TextOf(result, "budget")) return FaultsBeside(budget, planned, result);
    if (recipe.empty() || budget.RecipeOf(TextOf(result, "algorithm")) != recipe) continue;
    is_known_recipe = true;
    is_recipe |= planned && planned->cell_id == TextOf(result, "cell");
  }
  if (!is_known_recipe || is_recipe) return {};
  return {fmt::format("recipe is '{}', which has other hyperparameters", recipe)};
}

}  // namespace b4mrl
