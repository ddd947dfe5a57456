#include "benchmarks/plan/budget.h"

#include <fmt/format.h>

#include <algorithm>

#include "algorithms/datasets/import_name.h"
#include "algorithms/nn/products/precision.h"
#include "data/files/toml_keys.h"
#include "proto/base/folders.h"
#include "proto/base/limits.h"
#include "proto/base/names.h"

namespace b4mrl {
namespace {

constexpr uint64_t kMostSeeds = 10'000;  // of a cell

// "medium-expert" of "medium-expert", "HalfCheetah/medium-expert", "HalfCheetah/medium-expert-v0"
// and "d4rl/halfcheetah-medium-expert-v2".
std::string LevelOfDataset(const std::string& dataset) {
  const std::string name(WithoutVersion(dataset.substr(dataset.find('/') + 1)));
  return IsOfD4rl(dataset) ? name.substr(name.find('-') + 1) : name;
}

Result<BudgetException> ReadException(const toml::table& table, const std::string& where) {
  TomlKeys keys(table, where);
  BudgetException exception;
  B4MRL_ASSIGN_OR_RETURN(exception.algorithms, keys.Texts("algorithms"));
  B4MRL_ASSIGN_OR_RETURN(exception.simulators, keys.Texts("simulators"));
  B4MRL_ASSIGN_OR_RETURN(exception.datasets, keys.Texts("datasets"));
  for (std::string& dataset : exception.datasets) dataset = LevelOfDataset(dataset);
  B4MRL_ASSIGN_OR_RETURN(exception.updates, keys.Count("updates"));
  B4MRL_ASSIGN_OR_RETURN(exception.hyperparameters, keys.NamedValues("hyperparameters"));
  B4MRL_RETURN_IF_ERROR(keys.Finish());
  return exception;
}

// Reads hyperparameters, which are tables by algorithm of tables by name.
Status ReadHyperparameters(TomlKeys& keys, const std::string& where, Budget* out) {
  B4MRL_ASSIGN_OR_RETURN(const toml::table* table, keys.Table("hyperparameters"));
  if (table == nullptr) return Status();
  TomlKeys algorithms(*table, where + ".hyperparameters");
  for (const auto& [algorithm, values] : *table) {
    B4MRL_ASSIGN_OR_RETURN(out->hyperparameters[std::string(algorithm.str())],
                           algorithms.NamedValues(algorithm.str()));
  }
  return Status();
}

Status CheckPrecisionName(const std::string& where, const std::string& name) {
  if (FindPrecision(name)) return Status();
  return UnknownName(fmt::format("precision of {}", where), name,
                     std::vector<std::string>{"fp32", "bf16"});
}

Status ReadPrecisions(TomlKeys& keys, const std::string& where, Budget* out) {
  B4MRL_ASSIGN_OR_RETURN(const std::string precision, keys.Text("precision"));
  if (!precision.empty()) out->precision = precision;
  B4MRL_ASSIGN_OR_RETURN(out->precisions, keys.NamedTexts("precisions"));
  for (const auto& [algorithm, name] : out->precisions) {
    B4MRL_RETURN_IF_ERROR(CheckPrecisionName(where, name));
  }
  return CheckPrecisionName(where, out->precision);
}

Result<Budget> ReadTable(const toml::table& table, const std::string& where) {
  TomlKeys keys(table, where);
  Budget budget;
  B4MRL_RETURN_IF_ERROR(ReadPrecisions(keys, where, &budget));
  B4MRL_ASSIGN_OR_RETURN(const auto evaluations, keys.Count("evaluations"));
  B4MRL_ASSIGN_OR_RETURN(const auto episodes, keys.Count("episodes", limits::kMaxLanesPerSession));
  B4MRL_ASSIGN_OR_RETURN(const auto seeds, keys.Count("seeds", kMostSeeds));
  B4MRL_ASSIGN_OR_RETURN(budget.rows, keys.Count("rows"));
  B4MRL_ASSIGN_OR_RETURN(budget.learner_updates, keys.Count("learner-updates"));
  B4MRL_ASSIGN_OR_RETURN(budget.recipes, keys.NamedTexts("recipes"));
  B4MRL_ASSIGN_OR_RETURN(budget.updates, keys.Counts("updates"));
  B4MRL_RETURN_IF_ERROR(ReadHyperparameters(keys, where, &budget));
  B4MRL_ASSIGN_OR_RETURN(const auto exceptions, keys.Tables("exception"));
  B4MRL_RETURN_IF_ERROR(keys.Finish());
  budget.evaluations = evaluations.value_or(budget.evaluations);
  budget.episodes = static_cast<uint32_t>(episodes.value_or(budget.episodes));
  budget.seeds = static_cast<uint32_t>(seeds.value_or(budget.seeds));
  for (const toml::table* entry : exceptions) {
    B4MRL_ASSIGN_OR_RETURN(BudgetException exception,
                           ReadException(*entry, fmt::format("{}.exception", where)));
    budget.exceptions.push_back(std::move(exception));
  }
  if (!budget.updates.empty() || budget.learner_updates) return budget;
  return Status(StatusCode::kInvalidArgument,
                fmt::format("{}: 'updates' must be a table with an algorithm or more, or "
                            "'learner-updates' a number",
                            where));
}

// The budget `name` of a file that was read.
Result<Budget> BudgetOf(const toml::table& all, const std::string& file, const std::string& name) {
  const toml::table* table = all[name].as_table();
  if (table == nullptr && all.contains(name)) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("{}: '{}' must be a table, [{}]", file, name, name));
  }
  if (table == nullptr) {
    std::vector<std::string> names;
    for (const auto& [key, node] : all) names.emplace_back(key.str());
    return UnknownName(fmt::format("budget of {}", file), name, names);
  }
  B4MRL_ASSIGN_OR_RETURN(Budget budget, ReadTable(*table, fmt::format("{}, {}", file, name)));
  budget.name = name;
  return budget;
}

}  // namespace

const std::string& Budget::PrecisionOf(const std::string& algorithm) const {
  const auto found = precisions.find(algorithm);
  return found == precisions.end() ? precision : found->second;
}

bool BudgetException::Fits(const std::string& algorithm, const std::string& simulator,
                           const std::string& dataset) const {
  const auto has = [](const std::vector<std::string>& list, const std::string& text) {
    return list.empty() || std::ranges::count(list, text) > 0;
  };
  return has(algorithms, algorithm) && has(simulators, simulator) &&
         has(datasets, LevelOfDataset(dataset));
}

std::optional<uint64_t> Budget::UpdatesOf(const std::string& algorithm,
                                          const std::string& simulator,
                                          const std::string& dataset) const {
  const auto found = updates.find(algorithm);
  if (found == updates.end()) return std::nullopt;
  uint64_t result = found->second;
  for (const BudgetException& exception : exceptions) {
    if (exception.updates && exception.Fits(algorithm, simulator, dataset)) {
      result = *exception.updates;
    }
  }
  return result;
}

std::string Budget::RecipeOf(const std::string& algorithm) const {
  const auto found = recipes.find(algorithm);
  return found == recipes.end() ? "" : found->second;
}

Result<Budget> ReadBudget(const std::string& file, const std::string& name) {
  B4MRL_ASSIGN_OR_RETURN(const toml::table all, ReadTomlFile(file));
  const bool is_only = name.empty() && all.size() == 1;
  return BudgetOf(all, file, is_only ? std::string(all.begin()->first.str()) : name);
}

Result<std::vector<Budget>> ReadBudgets(const std::string& file) {
  B4MRL_ASSIGN_OR_RETURN(const toml::table all, ReadTomlFile(file));
  std::vector<Budget> budgets;
  for (const auto& [name, table] : all) {
    B4MRL_ASSIGN_OR_RETURN(Budget budget, BudgetOf(all, file, std::string(name.str())));
    budgets.push_back(std::move(budget));
  }
  return budgets;
}

std::string DefaultBudgetsFile() {
  return SharedFolder("", B4MRL_BENCHMARKS_FOLDER) + "/budgets.toml";
}

Result<Budget> FindBudget(const std::string& text) {
  const bool is_file = text.find('/') != std::string::npos || text.ends_with(".toml");
  return is_file ? ReadBudget(text, "") : ReadBudget(DefaultBudgetsFile(), text);
}

}  // namespace b4mrl
