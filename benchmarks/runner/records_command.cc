#include "benchmarks/runner/records_command.h"

#include <fmt/format.h>

#include <vector>

#include "algorithms/base/progress.h"
#include "benchmarks/plan/suite_plan.h"
#include "benchmarks/records/leaderboard.h"
#include "benchmarks/records/plain_text.h"
#include "client/interrupt.h"
#include "client/private_daemon.h"
#include "proto/base/exit_codes.h"
#include "proto/base/limits.h"
#include "proto/command_line/words.h"

namespace b4mrl {
namespace {

void AddSuites(CLI::App& app, std::string& suites) {
  app.add_option("--suites", suites, "folder of further suites");
}

void AddJobs(CLI::App& app, uint32_t& jobs) {
  app.add_option("--jobs", jobs, "processes at a time [cores]")->transform(Count(1, 1024));
}

}  // namespace

CLI::App* RecordsCommand::AddCheck(CLI::App& app) {
  CLI::App* command = app.add_subcommand(
      "check", "say whether results are sound, and score again the agents that lie beside them");
  command->add_option("path", check.path, "a result, or a folder of results")->required();
  AddJobs(*command, check.jobs);
  AddSuites(*command, suites);
  return command;
}

CLI::App* RecordsCommand::AddLeaderboard(CLI::App& app) {
  CLI::App* command = app.add_subcommand(
      "leaderboard", "print, for each benchmark, the algorithms of a folder of results as CSV");
  command->add_option("results", results, "folder of results")->required();
  AddSuites(*command, suites);
  return command;
}

CLI::App* RecordsCommand::AddEvaluate(CLI::App& app) {
  CLI::App* command = app.add_subcommand(
      "evaluate", "evaluate all agents of a folder, each once, several at a time");
  command->add_option("folder", evaluation.folder, "folder with agents")->required();
  AddJobs(*command, evaluation.jobs);
  command->add_option("--episodes", evaluation.episodes, "episodes of each agent [100]")
      ->transform(Count(1, limits::kMaxLanesPerSession));
  command
      ->add_option("--seed", evaluation.seed,
                   "seed of the starts; 0 has those of training's evaluations [1]")
      ->transform(Seed());
  command
      ->add_option("--endpoint", evaluation.endpoint,
                   "address of a daemon that all processes are to use [$B4MRL_ENDPOINT, else each "
                   "starts its own]")
      ->envname("B4MRL_ENDPOINT")
      ->check(Address());
  command->add_flag("--quiet", evaluation.quiet, "show no progress on stderr");
  return command;
}

Result<int> RecordsCommand::Check() const {
  B4MRL_ASSIGN_OR_RETURN(const PrivateDaemon daemon, PrivateDaemon::Start());
  B4MRL_ASSIGN_OR_RETURN(Client client, Client::Connect(daemon.endpoint()));
  B4MRL_ASSIGN_OR_RETURN(const PlanKnowledge knowledge, PlanKnowledge::Ask(client));
  CheckSources sources = {.plan = knowledge.sources(), .published = &knowledge.published()};
  sources.find_environment = [&](const std::string& name) { return client.FindEnvironment(name); };
  B4MRL_ASSIGN_OR_RETURN(sources.benchmarks, ReadBenchmarks(suites));
  B4MRL_ASSIGN_OR_RETURN(sources.budgets, ReadBudgets(DefaultBudgetsFile()));
  ResultCheckOptions asked = check;
  asked.endpoint = daemon.endpoint();
  B4MRL_ASSIGN_OR_RETURN(const auto checked, CheckResults(asked, sources));
  size_t sound = 0;
  for (const CheckedResult& result : checked) {
    const std::string agent =
        result.agent == AgentCheck::kScored ? result.agreement : "no agent is there";
    if (result.faults.empty() && result.agent == AgentCheck::kNotReached) {
      fmt::print("{}\n",
                 OnOneLine(fmt::format("unknown {} (its agent was not scored)", result.path)));
      continue;
    }
    if (result.faults.empty()) {
      fmt::print("{}\n", OnOneLine(fmt::format("sound {} ({})", result.path, agent)));
    }
    for (const std::string& fault : result.faults) {
      fmt::print("{}\n", OnOneLine(fmt::format("fault {}: {}", result.path, fault)));
    }
    sound += result.faults.empty() ? 1 : 0;
  }
  fmt::print("{} of {} results are sound\n", sound, checked.size());
  if (Interrupted()) return InterruptExitCode();
  return sound == checked.size() ? kExitDone : kExitFailed;
}

Result<int> RecordsCommand::PrintLeaderboard() const {
  B4MRL_ASSIGN_OR_RETURN(const auto benchmarks, ReadBenchmarks(suites));
  B4MRL_ASSIGN_OR_RETURN(const auto published, ReadPublishedDatasets());
  std::vector<std::string> skipped;
  B4MRL_ASSIGN_OR_RETURN(const std::string csv,
                         Leaderboard(results, benchmarks, published, &skipped));
  for (const std::string& reason : skipped) Tell(OnOneLine("left out: " + reason) + "\n");
  fmt::print("{}", csv);
  return kExitDone;
}

Result<int> RecordsCommand::Evaluate() const {
  B4MRL_ASSIGN_OR_RETURN(const AgentEvaluationSummary summary, EvaluateAgents(evaluation));
  fmt::print("{} of {} agents evaluated, {} failed; in {}/evaluations\n", summary.done,
             summary.agents, summary.failed.size(), evaluation.folder);
  for (const std::string& line : summary.failed) fmt::print("failed: {}\n", line);
  if (summary.interrupted) return InterruptExitCode();
  return summary.failed.empty() ? kExitDone : kExitFailed;
}

}  // namespace b4mrl
