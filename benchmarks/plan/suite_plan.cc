#include "benchmarks/plan/suite_plan.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <string_view>
#include <utility>

#include "algorithms/datasets/dataset_recipes.h"
#include "algorithms/list.h"
#include "proto/base/names.h"

namespace b4mrl {
namespace {

constexpr uint64_t kLongestSeedRange = 1'000;

Result<std::vector<uint64_t>> ChooseSeeds(const std::string& text, const Budget& budget) {
  uint64_t first = 0, last = budget.seeds - 1;
  if (!text.empty()) {
    const size_t dots = text.find("..");
    B4MRL_ASSIGN_OR_RETURN(first,
                           ParseUnsigned("--seeds", text.substr(0, dots), 0, UINT64_MAX - 1));
    last = first;
    if (dots != std::string::npos) {
      B4MRL_ASSIGN_OR_RETURN(last, ParseUnsigned("--seeds", text.substr(dots + 2), first,
                                                 std::min(first, UINT64_MAX - kLongestSeedRange) +
                                                     kLongestSeedRange - 1));
    }
  }
  std::vector<uint64_t> seeds;
  for (uint64_t seed = first; seed <= last; ++seed) seeds.push_back(seed);
  return seeds;
}

// What a dataset will hold, by its recipe; of a dataset without one, what its file holds.
Result<nlohmann::json> DescribeDataset(const std::string& name, const PublishedDatasets& published,
                                       Client& client) {
  if (const DatasetRecipe* recipe = FindRecipe(name)) {
    const std::string full_name = recipe->full_name();
    nlohmann::json described = {{"name", full_name},
                                {"format", 1},
                                {"rows", recipe->rows},
                                {"seed", recipe->seed},
                                {"simulator", recipe->simulator},
                                {"policies", nlohmann::json::array()}};
    const auto figures = published.find(full_name);
    if (figures != published.end()) described["policies"] = figures->second.policies_sha256;
    return described;
  }
  B4MRL_ASSIGN_OR_RETURN(const auto listed, client.ListDatasets());
  for (const pb::DatasetInfo& info : listed) {
    if (info.name() == name && !info.columns_sha256().empty()) {
      return DescribeRows(name, info.rows(), info.columns_sha256());
    }
  }
  return Status(StatusCode::kFailedPrecondition,
                fmt::format("dataset '{}' has no recipe and was not imported", name));
}

}  // namespace

Result<std::vector<Benchmark>> ReadBenchmarks(const std::string& suites) {
  B4MRL_ASSIGN_OR_RETURN(std::vector<Benchmark> all, ReadSuites({DefaultSuitesFolder(), suites}));
  for (Benchmark& benchmark : all) benchmark.dataset = ShortName(benchmark.dataset);
  return all;
}

nlohmann::json DescribeRows(const std::string& name, uint64_t rows,
                            const std::string& columns_sha256) {
  return {{"name", name}, {"rows", rows}, {"columns_sha256", columns_sha256}};
}

namespace {

Result<std::vector<Benchmark>> BenchmarksOf(const SuiteChoice& choice) {
  if (choice.source == "d4rl" && choice.learner) {
    return Status(StatusCode::kInvalidArgument,
                  "--data d4rl and --learner exclude each other: the clients that a learner of "
                  "your own uses open the benchmark's data, which are B4MRL's");
  }
  B4MRL_ASSIGN_OR_RETURN(std::vector<Benchmark> all, ReadBenchmarks(choice.suites));
  for (Benchmark& benchmark : all) {
    if (choice.source == "d4rl" && !benchmark.dataset.empty()) {
      benchmark.dataset = OfD4rl(benchmark.dataset);
    }
  }
  return all;
}

std::vector<std::string> PartsOf(std::string_view name) {
  std::vector<std::string> parts;
  for (size_t at = 0; at != std::string_view::npos;) {
    const size_t slash = name.find('/', at);
    parts.emplace_back(name.substr(at, slash == name.npos ? slash : slash - at));
    at = slash == name.npos ? slash : slash + 1;
  }
  return parts;
}

// The pattern nearest to one that fits no benchmark, as a user may have meant it: with those of its
// parts that do not fit a benchmark's replaced by them. "Hopper/claen/*" becomes "Hopper/clean/*".
std::string Corrected(const std::string& pattern, const std::string& benchmark) {
  const auto wanted = PartsOf(pattern);
  auto parts = PartsOf(benchmark);
  if (wanted.size() != parts.size()) return benchmark;
  for (size_t i = 0; i < parts.size(); ++i) {
    if (FitsPattern(parts[i], wanted[i])) parts[i] = wanted[i];
  }
  return fmt::format("{}", fmt::join(parts, "/"));
}

Status UnknownPattern(const std::string& pattern, const std::vector<std::string>& names,
                      const std::string& suites) {
  NearestName nearest(pattern);
  for (const std::string& name : names) nearest.Consider(Corrected(pattern, name));
  // The names would fill the screen, beginning with those of other environments.
  return Status(
      StatusCode::kUnknownName,
      fmt::format("unknown benchmark '{}'{} (`b4mrl list benchmarks{}` has all)", pattern,
                  nearest.nearest() ? fmt::format("; did you mean '{}'?", *nearest.nearest()) : "",
                  suites.empty() ? "" : " --suites " + suites));
}

// Sets all_benchmarks of the runs of a plan, by a plan of every benchmark.
Status AddAllBenchmarks(const SuiteChoice& choice, const Budget& budget, const PlanChoice& wanted,
                        PlanSources sources, std::vector<PlannedRun>* plan) {
  B4MRL_ASSIGN_OR_RETURN(const auto benchmarks, BenchmarksOf(choice));
  // A dataset that cannot be described is none of this plan's.
  sources.describe_dataset =
      [describe = sources.describe_dataset](const std::string& name) -> Result<nlohmann::json> {
    auto described = describe(name);
    return described.ok() ? *std::move(described) : nlohmann::json{{"name", name}};
  };
  B4MRL_ASSIGN_OR_RETURN(const auto all, MakePlan(benchmarks, budget, wanted, sources));
  std::map<std::string_view, const PlannedRun*> by_id;
  for (const PlannedRun& run : all) by_id.emplace(run.id, &run);
  for (PlannedRun& run : *plan) {
    const auto found = by_id.find(run.id);
    run.all_benchmarks = found == by_id.end() ? run.benchmarks : found->second->benchmarks;
  }
  return Status();
}

// Takes out the runs whose dataset nobody has made and the recipe cannot make.
Status LeaveOutUnmakeable(Client& client, SuitePlan* plan) {
  std::map<const DatasetRecipe*, size_t> unmakeable;  // their runs
  for (const PlannedRun& run : plan->runs) {
    const DatasetRecipe* recipe = FindRecipe(run.dataset);
    if (recipe != nullptr && !recipe->missing.empty()) ++unmakeable[recipe];
  }
  if (unmakeable.empty()) return Status();
  B4MRL_ASSIGN_OR_RETURN(const auto listed, client.ListDatasets());
  for (const pb::DatasetInfo& info : listed) unmakeable.erase(FindRecipe(info.name()));
  std::erase_if(plan->runs, [&](const PlannedRun& run) {
    return unmakeable.contains(FindRecipe(run.dataset));
  });
  for (const auto& [recipe, runs] : unmakeable) {
    plan->left_out.push_back(fmt::format(
        "runs left out: {}, as {} cannot be made: {}; `b4mrl dataset make {} --agent FILE` "
        "makes it with an agent of yours",
        runs, recipe->full_name(), recipe->missing, recipe->name));
  }
  return Status();
}

}  // namespace

std::string OfD4rl(const std::string& dataset) {
  std::string name = LowerCase(dataset);
  std::ranges::replace(name, '/', '-');
  return fmt::format("d4rl/{}-v2", name);
}

Result<std::vector<Benchmark>> ChooseBenchmarks(const SuiteChoice& choice) {
  B4MRL_ASSIGN_OR_RETURN(std::vector<Benchmark> all, BenchmarksOf(choice));
  std::vector<std::string> names;
  for (const Benchmark& benchmark : all) names.push_back(benchmark.name);
  for (const std::string& pattern : choice.patterns) {
    const bool fits = std::ranges::any_of(
        names, [&](const std::string& name) { return FitsPattern(name, pattern); });
    if (!fits) return UnknownPattern(pattern, names, choice.suites);
  }
  std::erase_if(all, [&](const Benchmark& benchmark) {
    const auto fits = [&](const std::string& p) { return FitsPattern(benchmark.name, p); };
    return !choice.patterns.empty() && std::ranges::none_of(choice.patterns, fits);
  });
  return all;
}

Status CheckServed(const std::vector<Benchmark>& benchmarks, Client& client) {
  B4MRL_ASSIGN_OR_RETURN(const auto catalogue, client.Catalogue(true));
  std::set<std::string_view> served;
  for (const pb::BenchmarkInfo& info : catalogue.benchmarks()) served.insert(info.name());
  for (const Benchmark& benchmark : benchmarks) {
    if (served.contains(benchmark.name)) continue;
    return Status(StatusCode::kFailedPrecondition,
                  fmt::format("the daemon at {} has no benchmark '{}'; start it with `b4mrl serve "
                              "--suites FOLDER`",
                              client.endpoint(), benchmark.name));
  }
  return Status();
}

Result<PlanKnowledge> PlanKnowledge::Ask(Client& client) {
  PlanKnowledge knowledge(client);
  B4MRL_ASSIGN_OR_RETURN(knowledge.catalogue_, client.Catalogue());
  B4MRL_ASSIGN_OR_RETURN(knowledge.published_, ReadPublishedDatasets());
  return knowledge;
}

PlanSources PlanKnowledge::sources() const {
  return {Algorithms(), &catalogue_,
          [this](const std::string& name) { return DescribeDataset(name, published_, *client_); }};
}

Result<SuitePlan> PlanSuite(const SuiteChoice& choice, const Budget& budget, Client& client) {
  B4MRL_ASSIGN_OR_RETURN(const auto benchmarks, ChooseBenchmarks(choice));
  B4MRL_ASSIGN_OR_RETURN(const PlanKnowledge knowledge, PlanKnowledge::Ask(client));
  const PlanSources sources = knowledge.sources();
  PlanChoice wanted = {choice.algorithms, {}, choice.learner};
  B4MRL_ASSIGN_OR_RETURN(wanted.seeds, ChooseSeeds(choice.seeds, budget));
  SuitePlan plan;
  B4MRL_ASSIGN_OR_RETURN(plan.runs, MakePlan(benchmarks, budget, wanted, sources));
  B4MRL_RETURN_IF_ERROR(LeaveOutUnmakeable(client, &plan));
  B4MRL_RETURN_IF_ERROR(AddAllBenchmarks(choice, budget, wanted, sources, &plan.runs));
  for (PlannedRun& run : plan.runs) {
    const DatasetRecipe* recipe = FindRecipe(run.dataset);
    if (recipe == nullptr || budget.rows) continue;
    const auto figures = knowledge.published().find(recipe->full_name());
    if (figures != knowledge.published().end()) run.columns_sha256 = figures->second.columns_sha256;
  }
  return plan;
}

}  // namespace b4mrl
