// b4mrl benchmark run|slurm|status|evaluate|check|leaderboard: trains what fills the cells of
// benchmarks, here or on a cluster, says how far that is, evaluates agents side by side, checks
// results and ranks them.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "algorithms/base/progress.h"
#include "algorithms/base/within_memory.h"
#include "benchmarks/plan/budget.h"
#include "benchmarks/plan/suite_plan.h"
#include "benchmarks/runner/dataset_jobs.h"
#include "benchmarks/runner/frozen_plan.h"
#include "benchmarks/runner/plan_status.h"
#include "benchmarks/runner/records_command.h"
#include "benchmarks/runner/runner.h"
#include "benchmarks/runner/submission.h"
#include "client/interrupt.h"
#include "client/private_daemon.h"
#include "data/files/make_folder.h"
#include "proto/base/child_program.h"
#include "proto/base/cores.h"
#include "proto/base/exit_codes.h"
#include "proto/base/folders.h"
#include "proto/base/limits.h"
#include "proto/base/version.h"
#include "proto/command_line/program.h"
#include "proto/command_line/words.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

// How long an interrupted command waits for a daemon that does not answer.
constexpr std::chrono::seconds kInterruptPatience{5};

// What is to be done with the runs that the words of a command choose.
enum class PlanWork { kTrain, kSubmit, kShow };

struct BenchmarkCommand {
  std::string budget = kDefaultBudget;
  SuiteChoice choice;
  UsersLearner learner;
  RunnerOptions options;
  std::optional<uint64_t> index;
  bool dry_run = false;
  bool json = false;  // of a dry run and of the status
  SlurmJob slurm;

  void AddTo(CLI::App& app);
  void AddRunOptions(CLI::App& app);
  void AddSlurmOptions(CLI::App& app);
  Result<int> Run(PlanWork work);
  // Whether the options go together: what a daemon elsewhere and a learner of the user's own have
  // no use for.
  Status CheckOptions() const;
  // A private daemon on a folder of datasets, which need not exist.
  Result<PrivateDaemon> StartDaemon(const std::string& data_folder) const;
  // What --index leaves of the plan.
  Result<std::vector<PlannedRun>> Chosen(std::vector<PlannedRun> plan) const;
  // The words by which each task of a cluster trains its run, but for its number.
  std::vector<std::string> TaskWords() const;
  Result<int> Submit(const std::vector<PlannedRun>& plan);
  int Report(const RunnerSummary& summary, size_t runs) const;
};

void BenchmarkCommand::AddTo(CLI::App& app) {
  app.add_option("pattern", choice.patterns,
                 "names of benchmarks, in which * stands for any text (b4mrl list benchmarks) "
                 "[every benchmark]");
  app.add_option(
      "--budget", budget,
      "smoke, small, paper or another of benchmarks/budgets.toml, or a file with one budget "
      "[small]");
  app.add_option("--algorithms", choice.algorithms,
                 "algorithms to train, joined by commas [all of the budget]")
      ->delimiter(',')
      ->allow_extra_args(false);
  app.add_option("--seeds", choice.seeds, "seeds: \"0\", \"0..2\" [as many as the budget says]");
  app.add_option("--suites", choice.suites, "folder of further suites");
  app.add_option(
         "--data", choice.source,
         "datasets: own, or d4rl for D4RL's files of the same levels, imported before; not with "
         "--learner [own]")
      ->check(CLI::IsMember({"own", "d4rl"}));
  app.add_option("--learner", learner.command,
                 "the shell's command of a learner of your own, instead of the algorithms");
  app.add_option("--name", learner.name, "name of your learner's algorithm in results and tables");
  app.add_option("--until-settled", options.until_settled,
                 "how often a run goes on for its updates again that is not known to have settled: "
                 "the mean score of its last fifth differs from that of the fifth before by more "
                 "than 1.5 points, or a return by more than 3% of its curve's span [0]")
      ->transform(Count(0, 1'000));
  app.add_option("--out", options.folder, "folder of the runs [runs/benchmark]");
  app.add_option("--results", options.results, "folder of the results [results, in --out]");
  app.add_option("--data-folder", options.data_folder,
                 "folder of the datasets [that of `b4mrl serve --data`; with a budget that "
                 "limits rows: data, in --out]");
  app.add_option("--endpoint", options.endpoint,
                 "address of a daemon that all processes are to use, with its datasets "
                 "[$B4MRL_ENDPOINT, else each starts its own]")
      ->envname("B4MRL_ENDPOINT")
      ->check(Address());
}

void BenchmarkCommand::AddRunOptions(CLI::App& app) {
  app.add_option("--jobs", options.jobs, "processes at a time [cores]")->transform(Count(1, 1024));
  app.add_option(
         "--hours", options.hours,
         "stop after so many hours, to be resumed; runs that can end by then come first [0: "
         "when all is done]")
      ->check(Number(0, 1e5));
  app.add_option("--index", index,
                 "only the run with this number in plan.json, in --out, which is written if it is "
                 "missing; waits while another process has the run")
      ->transform(Seed());
  app.add_flag("--retry", options.retry, "begin diverged runs anew");
  auto* dry = app.add_flag("--dry-run", dry_run, "list the runs and train nothing");
  app.add_flag("--json", json, "list the runs of a dry run as one JSON array")->needs(dry);
  app.add_flag("--quiet", options.quiet, "show no progress on stderr");
}

void BenchmarkCommand::AddSlurmOptions(CLI::App& app) {
  app.add_option("--time", slurm.time,
                 "time limit of a task, as sbatch reads it; a run that needs longer is saved and "
                 "queued again [4:00:00]");
  app.add_option("--array-parallelism", slurm.parallel_tasks,
                 "tasks at a time; several jobs share the number [no limit]")
      ->transform(Count(1, 1'000'000));
  app.add_option("--sbatch-option", slurm.sbatch_options,
                 "a further option of sbatch, as in --sbatch-option=--partition=long; may be "
                 "repeated, and comes after the script's own")
      ->allow_extra_args(false);
  app.add_flag("--retry", options.retry, "begin diverged runs anew");
  app.add_flag("--dry-run", dry_run,
               "write plan.json and the batch script, print the script and submit nothing");
}

Result<std::vector<PlannedRun>> BenchmarkCommand::Chosen(std::vector<PlannedRun> plan) const {
  if (!index) return plan;
  // Who only looks writes no list.
  B4MRL_ASSIGN_OR_RETURN(
      auto frozen, dry_run ? ReadFrozenPlan(options.folder) : FreezePlan(options.folder, plan));
  if (frozen.empty()) {
    for (const PlannedRun& run : plan) frozen.push_back(run.id);
  }
  B4MRL_ASSIGN_OR_RETURN(PlannedRun run, FindByIndex(frozen, *index, plan));
  return std::vector{std::move(run)};
}

std::vector<std::string> BenchmarkCommand::TaskWords() const {
  std::vector<std::string> words = {ProgramBesideThisOne("b4mrl"), "benchmark", "run"};
  words.insert(words.end(), choice.patterns.begin(), choice.patterns.end());
  const auto add = [&](const char* name, const std::string& value) {
    if (!value.empty()) words.insert(words.end(), {name, value});
  };
  add("--budget", budget);
  add("--algorithms", fmt::format("{}", fmt::join(choice.algorithms, ",")));
  add("--seeds", choice.seeds);
  add("--suites", choice.suites);
  add("--data", choice.source);
  add("--learner", learner.command);
  add("--name", learner.name);
  add("--out", options.folder);
  add("--results", options.results);
  add("--endpoint", options.endpoint);
  if (options.endpoint.empty()) add("--data-folder", options.data_folder);
  if (options.until_settled > 0) add("--until-settled", fmt::format("{}", options.until_settled));
  if (options.retry) words.push_back("--retry");
  words.insert(words.end(), {"--jobs", "1", "--quiet"});
  return words;
}

Result<int> BenchmarkCommand::Submit(const std::vector<PlannedRun>& plan) {
  SubmissionOptions submission = {.job = slurm,
                                  .results = options.results,
                                  .until_settled = options.until_settled,
                                  .retry = options.retry,
                                  .dry_run = dry_run};
  submission.job.folder = options.folder;
  submission.job.command = TaskWords();
  if (choice.learner) {
    Tell(
        fmt::format("a learner that is not done after {} (--time) gets SIGTERM and is started "
                    "again: it has to save its work and go on from it, or it never ends\n",
                    slurm.time));
  }
  if (options.endpoint.starts_with("ipc:") || options.endpoint.starts_with("tcp://127.")) {
    Tell(
        fmt::format("the daemon at {} is reached from its own machine alone: tasks on other nodes "
                    "will fail\n",
                    options.endpoint));
  }
  B4MRL_RETURN_IF_ERROR(SubmitMissingRuns(plan, submission));
  return kExitDone;
}

int BenchmarkCommand::Report(const RunnerSummary& summary, size_t runs) const {
  fmt::print("{} of {} runs done, {} failed, {} left; results in {}\n", summary.done, runs,
             summary.failed.size(), summary.left, options.results);
  for (const std::string& line : summary.failed) fmt::print("failed: {}\n", line);
  if (summary.interrupted) return InterruptExitCode();
  // A cluster takes the code 0 of its task for a run that is done.
  const bool lacks_result = index && summary.left > 0;
  return summary.failed.empty() && !lacks_result ? kExitDone : kExitFailed;
}

Result<PrivateDaemon> BenchmarkCommand::StartDaemon(const std::string& data_folder) const {
  PrivateDaemonOptions own = {.data_folder = data_folder, .arguments = {"--lease", "86400"}};
  own.no_data = access(data_folder.c_str(), F_OK) != 0;
  // It checks the suites, and a learner of the user's own, which may compute for hours between two
  // requests, asks it for the benchmark.
  if (!options.suites.empty()) own.arguments.push_back("--suites=" + options.suites);
  return PrivateDaemon::Start(own);
}

Status BenchmarkCommand::CheckOptions() const {
  if (!options.endpoint.empty() && !options.data_folder.empty()) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("--data-folder {} and the daemon at {} exclude each other: the data "
                              "are the daemon's (--endpoint or B4MRL_ENDPOINT)",
                              options.data_folder, options.endpoint));
  }
  if (!choice.learner) return Status();
  if (!choice.algorithms.empty()) {
    return InvalidArgument("--algorithms", fmt::format("{}", fmt::join(choice.algorithms, ",")),
                           "nothing with --learner, which is trained instead");
  }
  if (options.until_settled > 0) {
    return InvalidNumber("--until-settled", options.until_settled,
                         "0 with --learner, which is asked for the budget's updates alone");
  }
  return Status();
}

Result<int> BenchmarkCommand::Run(PlanWork work) {
  B4MRL_ASSIGN_OR_RETURN(const Budget chosen, FindBudget(budget));
  if (options.folder.empty()) options.folder = "runs/benchmark";
  if (options.results.empty()) options.results = options.folder + "/results";
  if (!learner.command.empty() || !learner.name.empty()) choice.learner = learner;
  B4MRL_RETURN_IF_ERROR(CheckOptions());
  if (options.endpoint.empty() && options.data_folder.empty()) {
    options.data_folder = chosen.rows ? options.folder + "/data" : DefaultDataFolder();
  }
  std::error_code error;
  if (!choice.suites.empty()) options.suites = fs::absolute(choice.suites, error);
  options.commit = BuildCommit();
  const bool looks = work == PlanWork::kShow || (work == PlanWork::kTrain && dry_run);
  // A mistake in a suite or a pattern is told as such, not as a daemon that does not start.
  B4MRL_ASSIGN_OR_RETURN(const auto benchmarks, ChooseBenchmarks(choice));
  std::optional<PrivateDaemon> daemon;
  if (options.endpoint.empty()) {
    options.data_folder = fs::absolute(options.data_folder, error);
    if (!looks) B4MRL_RETURN_IF_ERROR(MakeFolder(options.data_folder));
    B4MRL_ASSIGN_OR_RETURN(daemon, StartDaemon(options.data_folder));
  } else if (!options.suites.empty()) {
    // The daemon elsewhere is never told of these suites. One of this machine's own says what is
    // wrong with them, as it does where there is no other, and ends again.
    B4MRL_RETURN_IF_ERROR(StartDaemon("").status());
  }
  B4MRL_ASSIGN_OR_RETURN(Client client,
                         Client::Connect(daemon ? daemon->endpoint() : options.endpoint,
                                         limits::kDefaultDeadlineMs, &Interrupted()));
  // So that what learners have brought is still recorded after an interrupt.
  client.DelayCancellation(kInterruptPatience);
  B4MRL_ASSIGN_OR_RETURN(const pb::ServerStatusReply daemon_status, client.ServerStatus());
  if (!daemon) options.data_folder = daemon_status.data_folder();
  if (!daemon && choice.learner && work != PlanWork::kShow) {
    B4MRL_RETURN_IF_ERROR(CheckServed(benchmarks, client));
  }
  B4MRL_ASSIGN_OR_RETURN(SuitePlan suite, PlanSuite(choice, chosen, client));
  if (suite.runs.empty()) {
    return Status(StatusCode::kInvalidArgument,
                  suite.left_out.empty()
                      ? "the chosen benchmarks are defined for none of the chosen algorithms"
                      : fmt::format("{}", fmt::join(suite.left_out, "\n")));
  }
  for (const std::string& reason : suite.left_out) Tell(reason + "\n");
  const DatasetJobs datasets(
      client, {.data_folder = options.data_folder, .daemon_words = DaemonWordsOf(options)});
  const bool trains = !looks && work == PlanWork::kTrain;
  if (!trains) {
    B4MRL_ASSIGN_OR_RETURN(const auto refusals, datasets.Refusals(suite.runs));
    for (const std::string& refusal : refusals) Tell(refusal + "\n");
  }
  if (work != PlanWork::kSubmit) {
    B4MRL_ASSIGN_OR_RETURN(suite.runs, Chosen(std::move(suite.runs)));
  }
  // A learner of the user's own trains again on rows that were replaced, which it opens anyway.
  datasets.NoteRowsAtHand(trains && choice.learner.has_value(), &suite.runs);
  std::vector<PlannedRun>& plan = suite.runs;
  if (work == PlanWork::kSubmit) return Submit(plan);
  if (looks) {
    const PlanStatus status =
        StatusOf(plan, options.folder, options.results, options.until_settled);
    for (const std::string& problem : status.problems) Tell(problem + "\n");
    fmt::print("{}", json ? JsonOf(plan, status) : TextOf(plan, status));
    return kExitDone;
  }
  Runner runner(options, chosen, plan, client);
  B4MRL_ASSIGN_OR_RETURN(const RunnerSummary summary, runner.Work());
  return Report(summary, plan.size());
}

int ExitCodeOf(const Status& status) {
  switch (status.code()) {
    case StatusCode::kUnknownName:
      return kExitBadUsage;
    case StatusCode::kInvalidArgument:
      return IsOfOption(status) ? kExitBadUsage : kExitBadInput;
    case StatusCode::kUnavailable:
    case StatusCode::kDeadlineExceeded:
      return kExitNoDaemon;
    case StatusCode::kInternal:
      return kExitFailed;
    default:
      return kExitBadInput;
  }
}

int Main(int argc, char** argv) {
  CLI::App app("Trains what fills the cells of benchmarks.", "b4mrl benchmark");
  app.set_version_flag("--version", VersionText());
  app.require_subcommand(1);
  app.option_defaults()->multi_option_policy(CLI::MultiOptionPolicy::TakeLast);
  BenchmarkCommand run, cluster, status;
  run.options.jobs = ProcessorCount();
  CLI::App* run_app = app.add_subcommand("run", "train the runs that have no result yet");
  run.AddTo(*run_app);
  run.AddRunOptions(*run_app);
  CLI::App* slurm_app = app.add_subcommand(
      "slurm", "submit the runs that have no result yet to Slurm, as an array job");
  cluster.AddTo(*slurm_app);
  cluster.AddSlurmOptions(*slurm_app);
  CLI::App* status_app = app.add_subcommand(
      "status",
      "list the runs, how far they have come and where the messages of those are that "
      "have not ended well");
  status.AddTo(*status_app);
  status_app->add_flag("--json", status.json, "list the runs as one JSON array");
  RecordsCommand records;
  records.check.jobs = records.evaluation.jobs = run.options.jobs;
  CLI::App* evaluate_app = records.AddEvaluate(app);
  CLI::App* check_app = records.AddCheck(app);
  CLI::App* leaderboard_app = records.AddLeaderboard(app);
  if (const auto word_code = ParseWords(app, {argv + 1, argv + argc})) return *word_code;
  CatchInterrupts();
  Result<int> code = kExitFailed;
  const Status memory = WithinMemory("this command", [&] {
    code = evaluate_app->parsed()      ? records.Evaluate()
           : check_app->parsed()       ? records.Check()
           : leaderboard_app->parsed() ? records.PrintLeaderboard()
           : run_app->parsed()         ? run.Run(PlanWork::kTrain)
           : slurm_app->parsed()       ? cluster.Run(PlanWork::kSubmit)
                                       : status.Run(PlanWork::kShow);
    return Status();
  });
  if (!memory.ok()) {
    Tell(fmt::format("b4mrl benchmark: {}\n", memory.message()));
    return kExitFailed;
  }
  if (code.ok()) return *code;
  if (Interrupted()) return InterruptExitCode();
  Tell(fmt::format("b4mrl benchmark: {}\n", code.status().message()));
  return ExitCodeOf(code.status());
}

}  // namespace
}  // namespace b4mrl

int main(int argc, char** argv) {
  return b4mrl::RunProgram("b4mrl benchmark", [=] { return b4mrl::Main(argc, argv); });
}
