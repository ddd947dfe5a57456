// result.json: what has become of a run; and the lock by which one process at a time trains in a
// folder.
//
// The file says `running` from when the folder is locked, and how the run ended on every way out.
// Whoever is killed writes nothing more, and the kernel gives the lock back: a file that says
// `running` while nobody holds the lock is that of a killed run. A run that is continued keeps the
// scores that it had, until it has its own. Any process may read the file at any time; it is only
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
  kDiverged,     // its numbers are not finite any more
  kFailed,       // any other error
  kKilled,       // never written: see above
};
// "running" and so on, as in the file.
std::string_view RunStateName(RunState state);

struct TrainSummary {
  RunState state = RunState::kRunning;
  std::string reason;    // why it ended before its last update; otherwise ""
  uint64_t updates = 0;  // done so far
  uint64_t environment_steps = 0;
  std::optional<EvaluationResult> last;  // the last evaluation
  // Means over the last ten evaluations, or all if there were fewer.
  double mean_return_of_last_ten = 0;
  std::optional<double> mean_score_of_last_ten;
  std::string agent_path;
};

// One JSON object, without a line's end: what result.json holds.
std::string SummaryJson(const TrainOptions& options, const TrainSummary& summary);
// Atomic.
Status WriteResult(const TrainOptions& options, const TrainSummary& summary);
// Atomic: the same file with another state, its scores kept.
Status WriteResultState(const TrainOptions& options, RunState state, const std::string& reason);

// Held until the descriptor closes. kBusy when another process trains in the folder.
Result<UniqueFd> LockRunFolder(const std::string& folder);

struct RunStatus {
  RunState state = RunState::kRunning;
  std::string reason;
  uint64_t updates = 0;  // as of when the state was written: of a killed run, where it began
};
// Takes nobody's lock away. kIoError when the folder has no result.json: no run, or one that was
// killed before it began. kDataLoss when the file cannot be understood.
Result<RunStatus> ReadRunStatus(const std::string& folder);

}  // namespace b4mrl
