// result.json: what has become of a run; and the lock by which one process at a time trains in a
// folder.
//
// The file says `running` from when the folder is locked, and how the run ended on every way out.
// Whoever is killed writes nothing more, and the kernel gives the lock back: a file that says
// `running` while nobody holds the lock is that of a killed run. A run that is continued keeps its
// scores until it has new ones. Any process may read the file at any time; it is only
// ever replaced as a whole. Value types; no thread rule.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "algorithms/episodes/evaluate.h"
#include "algorithms/run/run_record.h"
#include "proto/base/status.h"
#include "proto/base/unique_fd.h"

namespace b4mrl {

enum class RunState {
  kRunning,
  kFinished,     // all updates done, or the score reached
  kInterrupted,  // told to stop
  kDiverged,     // losses or weights are not finite any more
  kFailed,       // any other error
  kKilled,       // the file says `running`, but nobody holds the lock; never written
};
// The state's name in the file: "running".
std::string_view RunStateName(RunState state);

struct TrainSummary {
  RunState state = RunState::kRunning;
  std::string reason;    // why the run ended before its last update; otherwise ""
  uint64_t updates = 0;  // gradient steps done so far
  uint64_t environment_steps = 0;
  std::optional<EvaluationResult> last;  // the last evaluation
  // Means over the last ten evaluations, or all if there were fewer.
  double mean_return_of_last_ten = 0;
  std::optional<double> mean_score_of_last_ten;
  std::string agent_path;
};

// The JSON object that result.json holds, without a newline.
std::string SummaryJson(const TrainOptions& options, const TrainSummary& summary);
// Writes result.json atomically.
Status WriteResult(const TrainOptions& options, const TrainSummary& summary);
// Gives result.json another state atomically, and keeps its scores.
Status WriteResultState(const TrainOptions& options, RunState state, const std::string& reason);

// The lock of a run's folder, held until the descriptor closes. kBusy when another process trains
// in the folder.
Result<UniqueFd> LockRunFolder(const std::string& folder);

struct RunStatus {
  RunState state = RunState::kRunning;
  std::string reason;
  uint64_t updates = 0;  // as of when the state was written: of a killed run, where it began
};
// Reads result.json without disturbing whoever holds the lock. kIoError when the folder has no
// result.json: no run, or one that was killed before it began. kDataLoss when the file cannot be
// understood.
Result<RunStatus> ReadRunStatus(const std::string& folder);

}  // namespace b4mrl
