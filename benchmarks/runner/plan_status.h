// How far the runs of a plan have come, and what the rest will cost. One thread.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "benchmarks/plan/plan.h"
#include "benchmarks/records/result_file.h"

namespace b4mrl {

enum class RunProgress {
  kDone,      // trained and scored
  kRunning,   // a runner holds its claim, on this machine or another one
  kDiverged,  // to be trained again only with --retry
  kFailed,    // given up by a runner; it is tried again when it is next begun
  kBegun,     // stopped or killed; goes on from its last checkpoint
  kWaiting,   // nothing was done yet
};
std::string_view RunProgressName(RunProgress progress);  // "done", "running", ...

struct PlannedRunStatus {
  RunProgress progress = RunProgress::kWaiting;
  std::optional<RunResult> result;
  uint64_t updates = 0;           // of the run's last evaluation
  uint64_t target = 0;            // updates that it is to train for
  std::optional<uint64_t> index;  // in plan.json
  std::string log;                // file of the learner's messages; "": there is none
  std::string failure;            // why a runner gave it up; "": none has, or it is not known
};

struct PlanStatus {
  std::vector<PlannedRunStatus> runs;  // of the plan
  std::vector<std::string> problems;   // what is wrong with files and results, one line each
  std::map<RunProgress, size_t> counts;
  size_t cells = 0, filled = 0;
  double seconds = 0;       // that the results say
  double seconds_left = 0;  // about, of one core

  size_t CountOf(RunProgress progress) const;
};

// Whether the run's folder holds the agent that the result has scored, so that it can be scored
// further.
bool HoldsAgentOf(const RunResult& result, const std::string& run_folder);

// Why the result of a run that is done is not what the run would bring now, one line each: another
// command of a user's learner has brought it, it has learned from other rows than those at hand, or
// it lacks scorings and its agent is gone.
std::vector<std::string> DoneOtherwise(const PlannedRun& run, const RunResult& result,
                                       const std::string& run_folder,
                                       const std::string& results_folder);

// `folder`: of the runs, with plan.json if there is one. `until_settled`: how often runs that have
// not settled are to go on, as in RunnerOptions.
PlanStatus StatusOf(const std::vector<PlannedRun>& plan, const std::string& folder,
                    const std::string& results_folder, uint32_t until_settled);

// A line for each run and one for all.
std::string TextOf(const std::vector<PlannedRun>& plan, const PlanStatus& status);
// One array, an object for each run.
std::string JsonOf(const std::vector<PlannedRun>& plan, const PlanStatus& status);

}  // namespace b4mrl
