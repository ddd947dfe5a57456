#include "benchmarks/records/check.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <filesystem>
#include <optional>
#include <set>
#include <string_view>
#include <utility>

#include "algorithms/datasets/dataset_recipes.h"
#include "algorithms/run/check_training.h"
#include "benchmarks/plan/perturbation_names.h"
#include "benchmarks/plan/suite_plan.h"
#include "benchmarks/records/budget_check.h"
#include "benchmarks/records/curve.h"
#include "benchmarks/records/json_file.h"
#include "benchmarks/records/result_file.h"
#include "benchmarks/records/scoring_check.h"
#include "proto/base/mean_and_std.h"
#include "proto/base/names.h"

namespace b4mrl {
namespace {

using Json = nlohmann::ordered_json;

class Checker {
 public:
  Checker(const Json& result, const CheckSources& sources) : result_(result), sources_(sources) {}

  std::vector<std::string> Check(const std::string& file_name);
  // The run of the result, with its ids and scorings.
  Result<PlannedRun> Identify() const;

 private:
  void CheckEntries();
  // What ids take for granted.
  void CheckConditions();
  void CheckUse();
  void CheckBenchmarks();
  // Whether the perturbations of an entry are these, presets or not: "hidden-high" is "hidden=9".
  bool IsSame(std::string_view key, const std::string& perturbations) const;
  // Whether the run of the result is one of the benchmark.
  bool HasValue(const Algorithm& algorithm, const std::string& name, double wanted) const;
  bool Fills(const Benchmark& benchmark) const;
  void CheckDataset();
  void CheckIds(const std::string& file_name);
  Result<PlannedRun> Described() const;
  void CheckScores();
  void CheckCurve();
  void CheckPoints(const Curve& curve, const std::vector<double>& returns);

  void Fault(std::string text) { faults_.push_back(std::move(text)); }
  void CheckText(std::string_view key, std::string_view must_be);
  void CheckNumber(std::string_view key, const std::optional<double>& must_be);
  bool IsUsers() const { return TextOf(result_, "source") != "own"; }
  // None for a learner of the user's own.
  const Algorithm* FindKnownAlgorithm() const;

  const Json& result_;
  const CheckSources& sources_;
  std::vector<std::string> faults_;
};

void Checker::CheckText(std::string_view key, std::string_view must_be) {
  const std::string text = TextOf(result_, key);
  if (text != must_be) Fault(fmt::format("{} is '{}', must be '{}'", key, text, must_be));
}

const Algorithm* Checker::FindKnownAlgorithm() const {
  const std::string name = TextOf(result_, "algorithm");
  const auto known =
      std::ranges::find(sources_.plan.algorithms, std::string_view(name), &Algorithm::name);
  return known == sources_.plan.algorithms.end() ? nullptr : &*known;
}

void Checker::CheckNumber(std::string_view key, const std::optional<double>& must_be) {
  const std::optional<double> number = NumberOf(result_, key);
  const auto shown = [](const std::optional<double>& value) {
    return value ? fmt::format("{}", *value) : "null";
  };
  if (!Agree(number, must_be)) {
    Fault(
        fmt::format("{} is {}, the other entries make it {}", key, shown(number), shown(must_be)));
  }
}

void Checker::CheckEntries() {
  for (const char* key : {"id", "cell", "suite", "algorithm", "environment", "budget", "source",
                          "selection", "version", "processor"}) {
    const bool may_lack = IsUsers() && std::string_view(key) == "budget";
    if (TextOf(result_, key).empty() && !may_lack) Fault(fmt::format("{} must be a text", key));
  }
  for (const char* key : {"seed", "updates", "planned_updates"}) {
    if (!CountOf(result_, key)) Fault(fmt::format("{} must be a whole number", key));
  }
  for (const char* key : {"return", "seconds"}) {
    if (!NumberOf(result_, key)) Fault(fmt::format("{} must be a number", key));
  }
  const bool has_diverged = HasDiverged(result_);
  if (!IsTrue(result_, "finished") && !has_diverged) Fault("the run has not finished");
  if (!has_diverged && !EntryOf(result_, "diverged").is_null()) {
    Fault(fmt::format("diverged must be a text of 1 to {} bytes, in a result that is not finished",
                      kMostDivergedBytes));
  }
  const auto updates = CountOf(result_, "updates"), planned = CountOf(result_, "planned_updates");
  if (!IsUsers() && !has_diverged && updates && planned && *updates < *planned) {
    Fault(fmt::format("updates is {}, fewer than planned_updates, {}", *updates, *planned));
  }
  CheckText("selection", "last");
  const std::string source = TextOf(result_, "source");
  if (source != "own" && source != "user" && source != "self-scored") {
    Fault(fmt::format("source is '{}', allowed: own, user, self-scored", source));
  }
  const std::string algorithm = TextOf(result_, "algorithm");
  if (IsUsers() && IsNameOfAlgorithm(algorithm, sources_.plan.algorithms)) {
    Fault(fmt::format("algorithm is '{}', a name of b4mrl's own", algorithm));
  } else if (IsUsers() && !IsLearnerName(algorithm)) {
    Fault(fmt::format("algorithm is '{}', allowed: 1 to {} letters, digits and dashes", algorithm,
                      kMostNameCharacters));
  }
}

void Checker::CheckConditions() {
  for (const auto& [key, must_be] : {std::pair{"corruption_seed", 0u}, std::pair{"history", 1u}}) {
    if (CountOf(result_, key) != must_be) {
      Fault(fmt::format("{} is {}, must be {}", key, EntryOf(result_, key).dump(), must_be));
    }
  }
  CheckText("transitions", "stored");
}

void Checker::CheckUse() {
  if (NumberOf(result_, "seconds").value_or(0) < 0) {
    Fault(fmt::format("seconds is {}, must be at least 0", EntryOf(result_, "seconds").dump()));
  }
  const auto used = [&](const char* key) { return CountOf(EntryOf(result_, "ledger"), key); };
  for (const char* key : {"simulator_steps", "query_rows", "dataset_rows", "evaluation_episodes"}) {
    if (!used(key)) Fault(fmt::format("ledger.{} must be a whole number", key));
  }
  const Algorithm* algorithm = FindKnownAlgorithm();
  if (algorithm == nullptr || IsUsers()) return;
  if (algorithm->needs.dataset && used("dataset_rows") == 0) {
    Fault(fmt::format("ledger.dataset_rows is 0, but {} learns from a dataset", algorithm->name));
  }
  if (algorithm->needs.simulator && used("simulator_steps") == 0 && used("query_rows") == 0) {
    Fault(fmt::format("ledger has no steps and no queries, but {} learns from a simulator",
                      algorithm->name));
  }
  // The returns of the last evaluation, and an episode or more of each before.
  const size_t least = EntryOf(result_, "returns").size() + EntryOf(result_, "curve").size();
  if (used("evaluation_episodes").value_or(least) + 1 < least) {
    Fault(fmt::format("ledger.evaluation_episodes is {}, fewer than the curve has",
                      *used("evaluation_episodes")));
  }
}

void Checker::CheckBenchmarks() {
  const Json& names = EntryOf(result_, "benchmarks");
  if (!names.is_array() || names.empty()) return Fault("benchmarks must be a list of names");
  const std::string suite = TextOf(result_, "suite");
  std::set<std::string> seen, suites;
  for (const Json& name : names) {
    const std::string text = name.is_string() ? name.get<std::string>() : "";
    if (!seen.insert(text).second) {
      // Others may have written it a hundred thousand times.
      return Fault(fmt::format("benchmark '{}' is listed twice", text));
    }
    const auto found = std::ranges::find(sources_.benchmarks, text, &Benchmark::name);
    if (found == sources_.benchmarks.end()) {
      Fault(fmt::format("benchmark '{}' is in no suite (--suites FOLDER for your own)", text));
      suites.insert(suite);  // of which it may be
      continue;
    }
    suites.insert(found->suite);
    if (!Fills(*found)) {
      Fault(
          fmt::format("the run fills no cell of benchmark '{}', whose simulator, dataset, "
                      "corruption or world is another, or which is not defined for its algorithm",
                      text));
    }
  }
  // Suites of several versions may have the same run.
  if (!suites.empty() && !suites.contains(suite)) {
    Fault(fmt::format("suite is '{}', its benchmarks are of '{}'", suite,
                      fmt::join(suites, "' and '")));
  }
}

bool Checker::IsSame(std::string_view key, const std::string& perturbations) const {
  const std::string environment = TextOf(result_, "environment");
  const auto own = Parametric(TextOf(result_, key), environment, *sources_.plan.catalogue);
  const auto other = Parametric(perturbations, environment, *sources_.plan.catalogue);
  return own.ok() && other.ok() && *own == *other;
}

// Records have the choices of hyperparameters by name, suites their numbers.
bool Checker::HasValue(const Algorithm& algorithm, const std::string& name, double wanted) const {
  Hyperparameters values(algorithm.hyperparameters);
  const Json& own = EntryOf(EntryOf(result_, "hyperparameters"), name);
  const std::string text = own.is_string() ? own.get<std::string>() : own.dump();
  return values.SetText(name, text).ok() && values.Number(name) == wanted;
}

bool Checker::Fills(const Benchmark& benchmark) const {
  const Algorithm* known = FindKnownAlgorithm();
  // Nobody knows what a learner of the user's own uses.
  const bool has_simulator = known == nullptr || known->needs.simulator;
  const bool has_dataset = known == nullptr || known->needs.dataset;
  const bool has_values = std::ranges::all_of(benchmark.hyperparameters, [&](const auto& wanted) {
    return known == nullptr || HasValue(*known, wanted.first, wanted.second);
  });
  const std::string expected = has_dataset ? benchmark.dataset : "";
  const std::string dataset = DatasetName(result_);
  return benchmark.DefinedFor(TextOf(result_, "algorithm")) && has_values &&
         TextOf(result_, "environment") == benchmark.environment &&
         IsSame("world", benchmark.world) &&
         IsSame("simulator", has_simulator ? benchmark.simulator : "") &&
         IsSame("corruption", has_dataset ? benchmark.corruption : "") &&
         (dataset == expected || (!expected.empty() && dataset == OfD4rl(expected)));
}

void Checker::CheckDataset() {
  const Json& dataset = EntryOf(result_, "dataset");
  if (dataset.is_null()) return;
  const std::string name = TextOf(dataset, "name");
  const auto published = sources_.published->find(name);
  if (published == sources_.published->end()) return;  // of the user's own, or D4RL's
  const auto budget = std::ranges::find(sources_.budgets, TextOf(result_, "budget"), &Budget::name);
  const bool is_whole = CountOf(dataset, "rows") == published->second.rows ||
                        (budget != sources_.budgets.end() && !budget->rows);
  if (is_whole && TextOf(dataset, "columns_sha256") != published->second.columns_sha256) {
    Fault(fmt::format("dataset {} has other rows than the published ones", name));
  }
}

Result<PlannedRun> Checker::Described() const {
  PlannedRun run;
  run.algorithm = TextOf(result_, "algorithm");
  run.environment = TextOf(result_, "environment");
  run.simulator = TextOf(result_, "simulator");
  run.corruption = TextOf(result_, "corruption");
  run.world = TextOf(result_, "world");
  run.suite = TextOf(result_, "suite");
  run.precision = TextOf(result_, "precision");
  run.seed = CountOf(result_, "seed").value_or(0);
  run.dataset = DatasetName(result_);
  run.benchmarks = TextsOf(result_, "benchmarks");
  if (IsUsers()) return run;
  const Algorithm* algorithm = FindKnownAlgorithm();
  if (algorithm == nullptr) {
    return Status(StatusCode::kUnknownName,
                  fmt::format("'{}' is no algorithm of b4mrl; source must be user", run.algorithm));
  }
  std::vector<std::pair<std::string, std::string>> texts;
  for (const auto& [name, value] : EntryOf(result_, "hyperparameters").items()) {
    texts.emplace_back(name, value.is_string() ? value.get<std::string>() : value.dump());
  }
  B4MRL_ASSIGN_OR_RETURN(const Hyperparameters resolved,
                         ReadHyperparameters(*algorithm, run.environment, texts));
  for (const Hyperparameter& entry : resolved.entries()) {
    run.hyperparameters[std::string(entry.name)] = entry.Text();
  }
  return run;
}

Result<PlannedRun> Checker::Identify() const {
  B4MRL_ASSIGN_OR_RETURN(PlannedRun run, Described());
  B4MRL_RETURN_IF_ERROR(IdentifyRun(&run, CountOf(EntryOf(result_, "dataset"), "rows"),
                                    PlanSourcesFor(result_, sources_)));
  return run;
}

void Checker::CheckIds(const std::string& file_name) {
  const Result<PlannedRun> run = Identify();
  if (!run.ok()) return Fault(run.status().message());
  CheckText("id", run->id);
  CheckText("cell", run->cell_id);
  if (const Json& dataset = EntryOf(result_, "dataset"); !dataset.is_null()) {
    // An id has the recipe's version, and no more rows than it.
    if (TextOf(dataset, "name") != run->full_dataset) {
      Fault(fmt::format("dataset.name is '{}', must be '{}'", TextOf(dataset, "name"),
                        run->full_dataset));
    }
    if (run->rows && CountOf(dataset, "rows") != run->rows) {
      Fault(fmt::format("dataset.rows is {}, allowed: at most the {} of {}",
                        EntryOf(dataset, "rows").dump(), *run->rows, run->full_dataset));
    }
  }
  for (std::string& fault : ScoringFaults(result_, *run, sources_)) Fault(std::move(fault));
  const std::string expected = fmt::format("{}-{}.json", run->name, run->id);
  if (file_name != expected) Fault(fmt::format("the file must be named {}", expected));
}

void Checker::CheckScores() {
  const auto returns = NumbersOf(result_, "returns");
  if (!returns || returns->empty()) return Fault("returns must be a list of numbers");
  const double mean = MeanAndStdOf(*returns).mean;
  CheckNumber("return", mean);
  const auto environment = sources_.find_environment(TextOf(result_, "environment"));
  if (!environment.ok()) return Fault(environment.status().message());
  CheckNumber("score", environment->NormalisedScore(mean));
}

void Checker::CheckCurve() {
  const std::optional<Curve> curve = ReadCurve(EntryOf(result_, "curve"));
  if (!curve || curve->empty()) {
    return Fault("curve must be a list of [updates, steps, return, std, score], updates ascending");
  }
  if (const auto returns = NumbersOf(result_, "returns")) CheckPoints(*curve, *returns);
  const CurvePoint& last = curve->back();
  CheckNumber("environment_steps", static_cast<double>(last.steps));
  CheckNumber("updates", static_cast<double>(last.updates));
  CheckNumber("return", last.mean_return);
  CheckNumber("score", last.score);
  const Fifths fifths = FifthsOf(*curve);
  CheckNumber("last_fifth", fifths.last);
  CheckNumber("fifth_before", fifths.before);
  const Json& settled = EntryOf(result_, "settled");
  const std::optional<bool> is_settled =
      HasSettled(fifths, last.updates,
                 LearnsUntil(TextOf(result_, "source"), EntryOf(result_, "hyperparameters")));
  if (is_settled ? settled != *is_settled : !settled.is_null()) {
    Fault(fmt::format("settled is {}, the curve makes it {}", settled.dump(),
                      is_settled ? (*is_settled ? "true" : "false") : "null"));
  }
}

void Checker::CheckPoints(const Curve& curve, const std::vector<double>& returns) {
  const auto environment = sources_.find_environment(TextOf(result_, "environment"));
  if (!environment.ok()) return;  // which CheckScores says
  for (const CurvePoint& each : curve) {
    const auto score = environment->NormalisedScore(each.mean_return);
    if (!Agree(each.score, score)) {
      return Fault(fmt::format("curve: the score after {} updates is not that of its return, {}",
                               each.updates, each.mean_return));
    }
    if (each.std_return < 0) {
      return Fault(
          fmt::format("curve: the standard deviation after {} updates is {}, must be at "
                      "least 0",
                      each.updates, each.std_return));
    }
  }
  if (!returns.empty() && !Agree(curve.back().std_return, MeanAndStdOf(returns).std)) {
    Fault(fmt::format("curve: the last standard deviation is {}, the returns make it {}",
                      curve.back().std_return, MeanAndStdOf(returns).std));
  }
}

std::vector<std::string> Checker::Check(const std::string& file_name) {
  CheckEntries();
  CheckConditions();
  CheckUse();
  CheckBenchmarks();
  CheckDataset();
  CheckIds(file_name);
  CheckScores();
  CheckCurve();
  return std::move(faults_);
}

}  // namespace

PlanSources PlanSourcesFor(const Json& result, const CheckSources& sources) {
  PlanSources plan = sources.plan;
  plan.describe_dataset =
      [&result, own = plan.describe_dataset](const std::string& name) -> Result<nlohmann::json> {
    if (FindRecipe(name) != nullptr) return own(name);
    const Json& dataset = EntryOf(result, "dataset");
    return DescribeRows(name, CountOf(dataset, "rows").value_or(0),
                        TextOf(dataset, "columns_sha256"));
  };
  return plan;
}

Result<PlannedRun> RunOfResult(const Json& result, const CheckSources& sources) {
  return Checker(result, sources).Identify();
}

Result<std::string> ScoredUnder(const Json& result, const CheckSources& sources) {
  if (TextOf(result, "source") == "own") return TextOf(result, "world");
  B4MRL_ASSIGN_OR_RETURN(const PlannedRun run, RunOfResult(result, sources));
  for (const Scoring& scoring : run.scorings) {
    if (scoring.name == kOwnScoring) return scoring.simulator;
  }
  return run.world;
}

std::vector<std::string> FaultsOf(const Json& result, const std::string& file,
                                  const CheckSources& sources) {
  auto faults = Checker(result, sources).Check(std::filesystem::path(file).filename());
  for (std::string& fault : BudgetFaults(result, sources)) faults.push_back(std::move(fault));
  return faults;
}

}  // namespace b4mrl
