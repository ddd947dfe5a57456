// `b4mrl benchmark check`, `leaderboard` and `evaluate`: what is said of results and agents that
// are there. Thread rule: one thread.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "benchmarks/runner/agent_evaluations.h"
#include "benchmarks/runner/result_checks.h"
#include "proto/base/status.h"

namespace b4mrl {

struct RecordsCommand {
  ResultCheckOptions check;
  AgentEvaluationOptions evaluation;
  std::string results, suites;

  // Add the commands; the object outlives them.
  CLI::App* AddCheck(CLI::App& app);
  CLI::App* AddLeaderboard(CLI::App& app);
  CLI::App* AddEvaluate(CLI::App& app);

  // Print what there is to say and return the exit code. Errors: those of CheckResults, Leaderboard
  // and EvaluateAgents, of the suites and of the private daemon.
  Result<int> Check() const;
  Result<int> PrintLeaderboard() const;
  Result<int> Evaluate() const;
};

}  // namespace b4mrl
