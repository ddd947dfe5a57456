// How far the runs of a plan have come, and what the rest will cost. One thread.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "benchmarks/plan/plan.h"
#include "benchmarks/records/result_file.h"

namespace b4mrl {

struct PlanStatus {
  std::vector<std::optional<RunResult>> results;  // of each run of the plan
  std::vector<std::string> unreadable;            // what is wrong with results, one line each
  size_t done = 0, begun = 0;                     // runs
  size_t cells = 0, filled = 0;
  double seconds = 0;       // that the results say
  double seconds_left = 0;  // about, of one core
};

PlanStatus StatusOf(const std::vector<PlannedRun>& plan, const std::string& results_folder);

// A line for each run and one for all.
std::string TextOf(const std::vector<PlannedRun>& plan, const PlanStatus& status);
// One array, an object for each run.
std::string JsonOf(const std::vector<PlannedRun>& plan, const PlanStatus& status);

}  // namespace b4mrl
