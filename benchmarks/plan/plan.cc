#include "benchmarks/plan/plan.h"

#include <fmt/format.h>
#include <fnmatch.h>

#include <algorithm>
#include <cctype>
#include <optional>
#include <utility>

#include "algorithms/base/hyperparameters.h"
#include "algorithms/datasets/dataset_recipes.h"
#include "algorithms/run/run_record.h"
#include "benchmarks/plan/perturbation_names.h"
#include "data/files/file_hash.h"

namespace b4mrl {
namespace {

using Json = nlohmann::json;  // its keys are sorted, so equal contents are equal texts

constexpr size_t kIdDigits = 16;

std::string IdOf(const Json& identity) {
  return Sha256OfText(identity.dump()).substr(0, kIdDigits);
}

// A name of a file of budgets or suites that is unknown is no mistake of the command line.
Status OfFile(const Status& status) {
  if (status.code() != StatusCode::kUnknownName) return status;
  return Status(StatusCode::kInvalidArgument, status.message());
}

class Planner {
 public:
  Planner(const Budget& budget, const PlanSources& sources) : budget_(budget), sources_(sources) {}

  // Adds the run of a cell, or the cell to the run that fills it.
  Status Add(const Benchmark& benchmark, const Algorithm& algorithm, uint64_t seed);
  Status AddUsersRun(const Benchmark& benchmark, const UsersLearner& learner, uint64_t seed);
  std::vector<PlannedRun> Take() { return std::move(runs_); }

  // Each sets what follows from the other fields of a run.
  Status SetIds(const Algorithm& algorithm, PlannedRun* run);
  Status SetUsersIds(PlannedRun* run);

 private:
  // A run of all that a benchmark has, without what it trains.
  static PlannedRun RunOf(const Benchmark& benchmark, uint64_t seed);
  // The run as the user would write it, with what its algorithm does not use left out.
  Result<PlannedRun> RunOf(const Benchmark& benchmark, const Algorithm& algorithm, uint64_t seed);
  // What the run sees and where it is scored, spelled out; sets what follows from it.
  Result<Json> Describe(bool is_users, PlannedRun* run);
  Status SetBudget(const Benchmark& benchmark, PlannedRun* run) const;
  Status SetScorings(const Json& conditions, bool is_users, PlannedRun* run) const;
  Result<Json> DescribeDataset(const std::string& name);

  const Budget& budget_;
  const PlanSources& sources_;
  std::vector<PlannedRun> runs_;
  std::map<std::string, size_t> by_id_;
  std::map<std::string, Json> datasets_;  // those that were described before
};

std::string NameOf(const PlannedRun& run, const LearnerNeeds& needs) {
  TrainOptions options;
  options.algorithm = run.algorithm;
  options.environment = run.environment;
  options.simulator = run.simulator;
  options.world = run.world;
  options.dataset = run.dataset;
  options.corruption = run.corruption;
  options.seed = run.seed;
  return RunName(options, needs);
}

Status Planner::AddUsersRun(const Benchmark& benchmark, const UsersLearner& learner,
                            uint64_t seed) {
  PlannedRun run = RunOf(benchmark, seed);
  run.learner = learner.command;
  run.algorithm = learner.name;
  run.updates = *budget_.learner_updates;
  run.benchmarks = {benchmark.name};
  B4MRL_RETURN_IF_ERROR(SetUsersIds(&run));
  runs_.push_back(std::move(run));
  return Status();
}

Status Planner::SetUsersIds(PlannedRun* run) {
  B4MRL_ASSIGN_OR_RETURN(const Json conditions, Describe(true, run));
  const Json& dataset = conditions["dataset"];
  Json identity = {{"algorithm", run->algorithm},
                   {"benchmark", run->benchmarks.front()},
                   {"rows", dataset.is_null() ? Json() : dataset.value("rows", Json())},
                   {"suite", run->suite}};
  run->cell_id = IdOf(identity);
  identity["seed"] = run->seed;
  run->id = IdOf(identity);
  run->name = NameOf(*run, {.simulator = true, .dataset = !run->dataset.empty()});
  return Status();
}

Status Planner::Add(const Benchmark& benchmark, const Algorithm& algorithm, uint64_t seed) {
  B4MRL_ASSIGN_OR_RETURN(PlannedRun run, RunOf(benchmark, algorithm, seed));
  const auto [entry, is_new] = by_id_.emplace(run.id, runs_.size());
  if (is_new) runs_.push_back(std::move(run));
  PlannedRun& kept = runs_[entry->second];
  kept.benchmarks.push_back(benchmark.name);
  return Status();
}

PlannedRun Planner::RunOf(const Benchmark& benchmark, uint64_t seed) {
  PlannedRun run;
  run.environment = benchmark.environment;
  run.simulator = benchmark.simulator;
  run.dataset = benchmark.dataset;
  run.corruption = benchmark.corruption;
  run.world = benchmark.world;
  run.suite = benchmark.suite;
  run.seed = seed;
  return run;
}

Result<PlannedRun> Planner::RunOf(const Benchmark& benchmark, const Algorithm& algorithm,
                                  uint64_t seed) {
  PlannedRun run = RunOf(benchmark, seed);
  run.algorithm = algorithm.name;
  run.precision = budget_.PrecisionOf(run.algorithm);
  run.recipe = budget_.RecipeOf(run.algorithm);
  if (!algorithm.needs.simulator) run.simulator.clear();
  if (!algorithm.needs.dataset) {
    run.dataset.clear();
    run.corruption.clear();
  }
  // However a benchmark spells them, equal runs have one name, and a budget's exceptions fit them.
  for (std::string* text : {&run.simulator, &run.corruption, &run.world}) {
    B4MRL_ASSIGN_OR_RETURN(*text, ByPresets(*text, run.environment, *sources_.catalogue));
  }
  B4MRL_RETURN_IF_ERROR(SetBudget(benchmark, &run));
  B4MRL_RETURN_IF_ERROR(SetIds(algorithm, &run).WithContext(benchmark.name));
  return run;
}

Status Planner::SetBudget(const Benchmark& benchmark, PlannedRun* run) const {
  run->updates = budget_.updates.at(run->algorithm);
  const auto found = budget_.hyperparameters.find(run->algorithm);
  if (found != budget_.hyperparameters.end()) run->hyperparameters = found->second;
  for (BudgetException exception : budget_.exceptions) {
    for (std::string& simulator : exception.simulators) {
      B4MRL_ASSIGN_OR_RETURN(simulator,
                             ByPresets(simulator, run->environment, *sources_.catalogue));
    }
    if (!exception.Fits(run->algorithm, run->simulator, run->dataset)) continue;
    run->updates = exception.updates.value_or(run->updates);
    for (const auto& [name, value] : exception.hyperparameters) {
      run->hyperparameters[name] = value;
    }
  }
  for (const auto& [name, value] : benchmark.hyperparameters) {
    run->hyperparameters[name] = fmt::format("{}", value);
  }
  return Status();
}

Result<Json> Planner::DescribeDataset(const std::string& name) {
  const auto found = datasets_.find(name);
  if (found != datasets_.end()) return found->second;
  B4MRL_ASSIGN_OR_RETURN(Json described, sources_.describe_dataset(name));
  // A file that somebody has imported cannot be made shorter.
  if (budget_.rows && FindRecipe(name) != nullptr) {
    described["rows"] = std::min(*budget_.rows, described.value("rows", *budget_.rows));
  }
  datasets_.emplace(name, described);
  return described;
}

// A learner sees its data as they are served or, without data, its simulator's observations.
Status Planner::SetScorings(const Json& conditions, bool is_users, PlannedRun* run) const {
  const char* seen = run->dataset.empty() ? "simulator" : "corruption";
  B4MRL_ASSIGN_OR_RETURN(auto items, ParseNamedArguments(conditions[seen].get<std::string>()));
  // What the behaviour policy did not see is hidden in its data.
  const Json& dataset = conditions["dataset"];
  if (dataset.contains("simulator")) {
    B4MRL_ASSIGN_OR_RETURN(
        const std::string recorded,
        Parametric(dataset["simulator"].get<std::string>(), run->environment, *sources_.catalogue));
    B4MRL_ASSIGN_OR_RETURN(const auto more, ParseNamedArguments(recorded));
    items.insert(items.end(), more.begin(), more.end());
  }
  B4MRL_ASSIGN_OR_RETURN(auto through_noise, ParseNamedArguments(run->world));
  std::vector<NamedArgument> masked = through_noise, hidden;
  const size_t of_world = through_noise.size();
  for (const NamedArgument& item : items) {
    if (item.name == "hidden") hidden.push_back(item);
    if (item.name == "obs-noise") through_noise.push_back(item);
  }
  masked.insert(masked.end(), hidden.begin(), hidden.end());
  run->hidden = FormatNamedArguments(hidden);
  // The project's agents carry their masks; what users leave may not.
  if (is_users) {
    run->scorings.push_back({kOwnScoring, FormatNamedArguments(masked), "trained"});
  }
  if (!hidden.empty()) run->scorings.push_back({"full", run->world, "full"});
  if (through_noise.size() > of_world) {
    run->scorings.push_back({"served", FormatNamedArguments(through_noise), "trained"});
  }
  return Status();
}

Result<Json> Planner::Describe(bool is_users, PlannedRun* run) {
  Json conditions = {{"environment", run->environment}, {"dataset", nullptr}};
  for (const auto& [key, text] :
       {std::pair{"simulator", &run->simulator}, std::pair{"corruption", &run->corruption},
        std::pair{"world", &run->world}}) {
    B4MRL_ASSIGN_OR_RETURN(conditions[key],
                           Parametric(*text, run->environment, *sources_.catalogue));
  }
  run->full_dataset.clear();
  if (!run->dataset.empty()) {
    B4MRL_ASSIGN_OR_RETURN(conditions["dataset"], DescribeDataset(run->dataset));
    const Json& described = conditions["dataset"];
    run->full_dataset = described.value("name", run->dataset);
    if (described.contains("rows")) run->rows = described["rows"].get<uint64_t>();
  }
  B4MRL_RETURN_IF_ERROR(SetScorings(conditions, is_users, run));
  return conditions;
}

Status Planner::SetIds(const Algorithm& algorithm, PlannedRun* run) {
  Hyperparameters resolved(algorithm.hyperparameters, run->environment);
  for (const auto& [name, value] : run->hyperparameters) {
    B4MRL_RETURN_IF_ERROR(OfFile(resolved.SetText(name, value)));
  }
  B4MRL_ASSIGN_OR_RETURN(Json identity, Describe(false, run));
  identity["algorithm"] = run->algorithm;
  identity["transitions"] = "stored";
  identity["history"] = 1;
  identity["corruption_seed"] = 0;
  identity["hyperparameters"] = Json::object();
  for (const Hyperparameter& entry : resolved.entries()) {
    if (entry.is_without_effect) continue;
    identity["hyperparameters"][std::string(entry.name)] = entry.value;
  }
  run->cell_id = IdOf(identity);
  identity["seed"] = run->seed;
  identity["precision"] = run->precision;
  run->id = IdOf(identity);
  run->name = NameOf(*run, algorithm.needs);
  return Status();
}

// Whether a budget's algorithms are among these names.
Status CheckNamesOf(const Budget& budget, const std::vector<std::string>& names) {
  std::vector<std::string> used;
  for (const auto& [name, unused] : budget.updates) used.push_back(name);
  for (const auto& [name, unused] : budget.precisions) used.push_back(name);
  for (const auto& [name, unused] : budget.recipes) used.push_back(name);
  for (const auto& [name, unused] : budget.hyperparameters) used.push_back(name);
  for (const BudgetException& exception : budget.exceptions) {
    used.insert(used.end(), exception.algorithms.begin(), exception.algorithms.end());
  }
  for (const std::string& name : used) {
    if (std::ranges::count(names, name) > 0) continue;
    return OfFile(UnknownName(fmt::format("algorithm of the budget {}", budget.name), name, names));
  }
  return Status();
}

// Whether the simulators of a budget's exceptions exist: one that fits none would say nothing.
Status CheckSimulatorsOf(const Budget& budget, const pb::CatalogueReply& catalogue) {
  for (const BudgetException& exception : budget.exceptions) {
    for (const std::string& simulator : exception.simulators) {
      const std::string context = fmt::format("exception of the budget {}", budget.name);
      B4MRL_RETURN_IF_ERROR(OfFile(CheckPerturbations(simulator, catalogue)).WithContext(context));
    }
  }
  return Status();
}

// The algorithms that the budget gives updates, of those that were chosen, in the list's order.
Result<std::vector<const Algorithm*>> ChosenAlgorithms(const Budget& budget,
                                                       const PlanChoice& choice,
                                                       std::span<const Algorithm> algorithms) {
  std::vector<std::string> names;
  for (const Algorithm& algorithm : algorithms) names.emplace_back(algorithm.name);
  for (const std::string& name : choice.algorithms) {
    if (std::ranges::count(names, name) == 0) return UnknownName("algorithm", name, names);
  }
  B4MRL_RETURN_IF_ERROR(CheckNamesOf(budget, names));
  for (const std::string& name : choice.algorithms) {
    if (budget.updates.contains(name)) continue;
    return Status(
        StatusCode::kInvalidArgument,
        fmt::format("--algorithms {}: the budget {} gives it no updates", name, budget.name));
  }
  std::vector<const Algorithm*> chosen;
  for (const Algorithm& algorithm : algorithms) {
    const bool wanted =
        choice.algorithms.empty() || std::ranges::count(choice.algorithms, algorithm.name) > 0;
    if (wanted && budget.updates.contains(std::string(algorithm.name))) {
      chosen.push_back(&algorithm);
    }
  }
  return chosen;
}

Status CheckLearner(const UsersLearner& learner, const Budget& budget,
                    std::span<const Algorithm> algorithms) {
  if (!IsLearnerName(learner.name)) {
    return InvalidArgument("--name", learner.name,
                           fmt::format("1 to {} letters, digits and dashes", kMostNameCharacters));
  }
  if (IsNameOfAlgorithm(learner.name, algorithms)) {
    return InvalidArgument("--name", learner.name,
                           "a name that no algorithm of b4mrl has, in capitals or not");
  }
  if (learner.command.empty()) return InvalidArgument("--learner", "", "a command");
  if (budget.learner_updates) return Status();
  return Status(
      StatusCode::kInvalidArgument,
      fmt::format("the budget {} has no 'learner-updates': add `learner-updates = N`, the "
                  "number of updates that your learner is asked for",
                  budget.name));
}

}  // namespace

bool IsLearnerName(std::string_view name) {
  return !name.empty() && name.size() <= kMostNameCharacters &&
         std::ranges::all_of(name, [](char c) {
           return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '-';
         });
}

bool IsNameOfAlgorithm(const std::string& name, std::span<const Algorithm> algorithms) {
  const auto lower = [](char c) { return std::tolower(static_cast<unsigned char>(c)); };
  return std::ranges::any_of(algorithms, [&](const Algorithm& algorithm) {
    return std::ranges::equal(algorithm.name, name, {}, lower, lower);
  });
}

Result<std::vector<PlannedRun>> MakePlan(std::span<const Benchmark> benchmarks,
                                         const Budget& budget, const PlanChoice& choice,
                                         const PlanSources& sources) {
  B4MRL_ASSIGN_OR_RETURN(const auto algorithms,
                         ChosenAlgorithms(budget, choice, sources.algorithms));
  B4MRL_RETURN_IF_ERROR(CheckSimulatorsOf(budget, *sources.catalogue));
  Planner planner(budget, sources);
  if (choice.learner) {
    B4MRL_RETURN_IF_ERROR(CheckLearner(*choice.learner, budget, sources.algorithms));
  }
  for (const uint64_t seed : choice.seeds) {
    for (const Benchmark& benchmark : benchmarks) {
      if (choice.learner) {
        if (!benchmark.DefinedFor(choice.learner->name)) continue;
        B4MRL_RETURN_IF_ERROR(planner.AddUsersRun(benchmark, *choice.learner, seed));
        continue;
      }
      for (const Algorithm* algorithm : algorithms) {
        const bool has_data = !algorithm->needs.dataset || !benchmark.dataset.empty();
        if (!has_data || !benchmark.DefinedFor(algorithm->name)) continue;
        B4MRL_RETURN_IF_ERROR(planner.Add(benchmark, *algorithm, seed));
      }
    }
  }
  return planner.Take();
}

Status IdentifyRun(PlannedRun* run, std::optional<uint64_t> rows, const PlanSources& sources) {
  Budget budget;
  budget.rows = rows;
  Planner planner(budget, sources);
  const auto algorithm =
      std::ranges::find(sources.algorithms, std::string_view(run->algorithm), &Algorithm::name);
  if (algorithm != sources.algorithms.end()) return planner.SetIds(*algorithm, run);
  if (run->benchmarks.size() == 1) return planner.SetUsersIds(run);
  return Status(StatusCode::kInvalidArgument,
                fmt::format("a run of {} must name one benchmark", run->algorithm));
}

bool FitsPattern(const std::string& name, const std::string& pattern) {
  return fnmatch(pattern.c_str(), name.c_str(), FNM_NOESCAPE) == 0;
}

}  // namespace b4mrl
