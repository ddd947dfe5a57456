// b4mrl benchmark run|status|evaluate: trains what fills the cells of benchmarks, says how far that
// is, and evaluates agents side by side.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "algorithms/datasets/dataset_recipes.h"
#include "algorithms/datasets/published_datasets.h"
#include "algorithms/list.h"
#include "benchmarks/runner/agent_evaluations.h"
#include "benchmarks/runner/runner.h"
#include "client/interrupt.h"
#include "client/private_daemon.h"
#include "proto/base/folders.h"
#include "proto/base/limits.h"

namespace b4mrl {
namespace {

constexpr int kExitDone = 0, kExitFailed = 1, kExitBadUsage = 2, kExitBadInput = 3;
constexpr uint64_t kMostSeeds = 1'000;

struct BenchmarkCommand {
  std::vector<std::string> patterns;
  std::string budget = "small", seeds, suites;
  PlanChoice choice;
  RunnerOptions options;
  bool dry_run = false;

  void AddTo(CLI::App& app);
  Result<int> Run(bool status_only);
  Result<std::vector<Benchmark>> ChosenBenchmarks() const;
  Result<std::vector<PlannedRun>> Plan(const Budget& budget, Client& client);
  Status ChooseSeeds(const Budget& budget);
  int Report(const RunnerSummary& summary, size_t runs) const;
};

void BenchmarkCommand::AddTo(CLI::App& app) {
  app.add_option("pattern", patterns,
                 "names of benchmarks, in which * stands for any text (b4mrl list benchmarks) "
                 "[every benchmark]");
  app.add_option("--budget", budget, "smoke, small or paper, or a file with one budget [small]");
  app.add_option("--algorithms", choice.algorithms, "algorithms to train [all of the budget]")
      ->delimiter(',');
  app.add_option("--seeds", seeds, "seeds: \"0\", \"0..2\" [as many as the budget says]");
  app.add_option("--suites", suites, "folder of further suites");
  app.add_option("--out", options.folder, "folder of the runs [runs/benchmark]");
  app.add_option("--results", options.results, "folder of the results [results, in --out]");
  app.add_option("--data", options.data_folder,
                 "folder of the datasets [$B4MRL_DATA or ~/.local/share/b4mrl; with a budget that "
                 "limits rows: data, in --out]");
}

Status BenchmarkCommand::ChooseSeeds(const Budget& chosen) {
  uint64_t first = 0, last = chosen.seeds - 1;
  if (!seeds.empty()) {
    const size_t dots = seeds.find("..");
    B4MRL_ASSIGN_OR_RETURN(first,
                           ParseUnsigned("--seeds", seeds.substr(0, dots), 0, UINT64_MAX - 1));
    last = first;
    if (dots != std::string::npos) {
      B4MRL_ASSIGN_OR_RETURN(
          last, ParseUnsigned("--seeds", seeds.substr(dots + 2), first, first + kMostSeeds - 1));
    }
  }
  for (uint64_t seed = first; seed <= last; ++seed) choice.seeds.push_back(seed);
  return Status();
}

Result<std::vector<Benchmark>> BenchmarkCommand::ChosenBenchmarks() const {
  B4MRL_ASSIGN_OR_RETURN(std::vector<Benchmark> all, ReadSuites({DefaultSuitesFolder(), suites}));
  std::vector<std::string> names;
  for (const Benchmark& benchmark : all) names.push_back(benchmark.name);
  for (const std::string& pattern : patterns) {
    const bool fits = std::ranges::any_of(
        names, [&](const std::string& name) { return FitsPattern(name, pattern); });
    if (!fits) return UnknownName("benchmark", pattern, names);
  }
  std::erase_if(all, [&](const Benchmark& benchmark) {
    const auto fits = [&](const std::string& p) { return FitsPattern(benchmark.name, p); };
    return !patterns.empty() && std::ranges::none_of(patterns, fits);
  });
  return all;
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
    if (info.name() == name && !info.sha256().empty()) {
      return nlohmann::json{{"name", name}, {"sha256", info.sha256()}};
    }
  }
  return Status(StatusCode::kUnknownName,
                fmt::format("dataset '{}' has no recipe and was not imported", name));
}

Result<std::vector<PlannedRun>> BenchmarkCommand::Plan(const Budget& chosen, Client& client) {
  B4MRL_ASSIGN_OR_RETURN(const auto benchmarks, ChosenBenchmarks());
  B4MRL_ASSIGN_OR_RETURN(const pb::CatalogueReply catalogue, client.Catalogue());
  B4MRL_ASSIGN_OR_RETURN(const PublishedDatasets published, ReadPublishedDatasets());
  B4MRL_RETURN_IF_ERROR(ChooseSeeds(chosen));
  const PlanSources sources = {Algorithms(), &catalogue, [&](const std::string& name) {
                                 return DescribeDataset(name, published, client);
                               }};
  B4MRL_ASSIGN_OR_RETURN(std::vector<PlannedRun> plan,
                         MakePlan(benchmarks, chosen, choice, sources));
  for (PlannedRun& run : plan) {
    const DatasetRecipe* recipe = FindRecipe(run.dataset);
    if (recipe == nullptr || chosen.rows) continue;
    const auto figures = published.find(recipe->full_name());
    if (figures != published.end()) run.columns_sha256 = figures->second.columns_sha256;
  }
  return plan;
}

int BenchmarkCommand::Report(const RunnerSummary& summary, size_t runs) const {
  fmt::print("{} of {} runs done, {} failed, {} left; results in {}\n", summary.done, runs,
             summary.failed.size(), summary.left, options.results);
  for (const std::string& line : summary.failed) fmt::print("failed: {}\n", line);
  if (summary.interrupted) return InterruptExitCode();
  return summary.failed.empty() ? kExitDone : kExitFailed;
}

Result<Budget> FindBudget(const std::string& text) {
  const bool is_file = text.find('/') != std::string::npos || text.ends_with(".toml");
  return is_file ? ReadBudget(text, "") : ReadBudget(DefaultBudgetsFile(), text);
}

// Prints each run with how far it has come.
Status PrintStatus(const std::vector<PlannedRun>& plan, const std::string& results) {
  size_t done = 0, begun = 0, cells = 0, filled = 0;
  double seconds = 0;
  for (const PlannedRun& run : plan) {
    B4MRL_ASSIGN_OR_RETURN(const auto result, ReadResult(ResultPath(results, run)));
    const bool finished = result && result->finished && result->updates >= run.updates;
    done += finished ? 1 : 0;
    begun += result && !finished ? 1 : 0;
    cells += run.benchmarks.size();
    filled += finished ? run.benchmarks.size() : 0;
    seconds += result ? result->seconds : 0;
    const std::string score =
        !result ? "" : fmt::format(", {:.1f}", result->score.value_or(result->mean_return));
    fmt::print("{} {:>9}/{} {}{}\n", run.id, result ? result->updates : 0, run.updates, run.name,
               score);
  }
  fmt::print("{} runs: {} done, {} begun; {} of {} cells filled; {:.1f} hours trained\n",
             plan.size(), done, begun, filled, cells, seconds / 3600);
  return Status();
}

Result<int> BenchmarkCommand::Run(bool status_only) {
  B4MRL_ASSIGN_OR_RETURN(const Budget chosen, FindBudget(budget));
  if (options.folder.empty()) options.folder = "runs/benchmark";
  if (options.results.empty()) options.results = options.folder + "/results";
  if (options.data_folder.empty()) {
    options.data_folder = chosen.rows ? options.folder + "/data" : DefaultDataFolder();
  }
  std::error_code error;
  std::filesystem::create_directories(options.data_folder, error);
  if (error) return IoError("make", options.data_folder, error.value());
  PrivateDaemonOptions daemon_options;
  daemon_options.data_folder = options.data_folder;
  B4MRL_ASSIGN_OR_RETURN(const PrivateDaemon daemon, PrivateDaemon::Start(daemon_options));
  B4MRL_ASSIGN_OR_RETURN(
      Client client,
      Client::Connect(daemon.endpoint(), limits::kDefaultDeadlineMs, &Interrupted()));
  B4MRL_ASSIGN_OR_RETURN(const std::vector<PlannedRun> plan, Plan(chosen, client));
  if (status_only || dry_run) {
    B4MRL_RETURN_IF_ERROR(PrintStatus(plan, options.results));
    return kExitDone;
  }
  Runner runner(options, chosen, plan, client);
  B4MRL_ASSIGN_OR_RETURN(const RunnerSummary summary, runner.Work());
  return Report(summary, plan.size());
}

Result<int> EvaluateFolder(const AgentEvaluationOptions& options) {
  B4MRL_ASSIGN_OR_RETURN(const AgentEvaluationSummary summary, EvaluateAgents(options));
  fmt::print("{} of {} agents evaluated, {} failed; in {}/evaluations\n", summary.done,
             summary.agents, summary.failed.size(), options.folder);
  for (const std::string& line : summary.failed) fmt::print("failed: {}\n", line);
  if (summary.interrupted) return InterruptExitCode();
  return summary.failed.empty() ? kExitDone : kExitFailed;
}

int Main(int argc, char** argv) {
  CLI::App app("Trains what fills the cells of benchmarks.", "b4mrl benchmark");
  app.require_subcommand(1);
  BenchmarkCommand run, status;
  run.options.jobs = std::max(1u, std::thread::hardware_concurrency());
  CLI::App* run_app = app.add_subcommand("run", "train the runs that have no result yet");
  run.AddTo(*run_app);
  run_app->add_option("--jobs", run.options.jobs, "processes at a time [cores]")
      ->check(CLI::Range(1, 1024));
  run_app->add_option("--hours", run.options.hours, "start no run after so many hours")
      ->check(CLI::Range(0.0, 1e5));
  run_app->add_flag("--retry", run.options.retry, "begin diverged runs anew");
  run_app->add_flag("--dry-run", run.dry_run, "list the runs and train nothing");
  run_app->add_flag("--quiet", run.options.quiet, "show no progress on stderr");
  CLI::App* status_app = app.add_subcommand("status", "list the runs and how far they have come");
  status.AddTo(*status_app);
  AgentEvaluationOptions evaluation;
  evaluation.jobs = run.options.jobs;
  CLI::App* evaluate_app = app.add_subcommand(
      "evaluate", "evaluate all agents of a folder, each once, several at a time");
  evaluate_app->add_option("folder", evaluation.folder, "folder with agents")->required();
  evaluate_app->add_option("--jobs", evaluation.jobs, "processes at a time [cores]")
      ->check(CLI::Range(1, 1024));
  evaluate_app->add_option("--episodes", evaluation.episodes, "episodes of each agent [100]")
      ->check(CLI::Range(1u, limits::kMaxLanesPerSession));
  evaluate_app->add_option("--seed", evaluation.seed,
                           "seed of the starts; 0 has those of training's evaluations [1]");
  evaluate_app->add_flag("--quiet", evaluation.quiet, "show no progress on stderr");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? kExitDone : kExitBadUsage;
  }
  CatchInterrupts();
  const Result<int> code = evaluate_app->parsed() ? EvaluateFolder(evaluation)
                           : run_app->parsed()    ? run.Run(false)
                                                  : status.Run(true);
  if (code.ok()) return *code;
  fmt::print(stderr, "b4mrl benchmark: {}\n", code.status().message());
  return code.status().code() == StatusCode::kUnknownName ? kExitBadUsage : kExitBadInput;
}

}  // namespace
}  // namespace b4mrl

int main(int argc, char** argv) { return b4mrl::Main(argc, argv); }
