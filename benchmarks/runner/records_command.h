// `b4mrl benchmark check` and `leaderboard`: what is said of results that are there. Thread rule:
// one thread.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "benchmarks/runner/result_checks.h"
#include "proto/base/status.h"

namespace b4mrl {

struct RecordsCommand {
  ResultCheckOptions check;
  std::string results, suites;

  // Add the commands; the object outlives them.
  CLI::App* AddCheck(CLI::App& app);
  CLI::App* AddLeaderboard(CLI::App& app);

  // Print what there is to say and return the exit code. Errors: those of CheckResults and
  // Leaderboard, of the suites and of the private daemon.
  Result<int> Check() const;
  Result<int> PrintLeaderboard() const;
};

}  // namespace b4mrl
