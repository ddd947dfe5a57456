// result.json, which holds a run's state and scores, and the lock by which one process at a time
// trains in a folder.
//
// The state is `running` from when the folder is locked, and every way out of training replaces it.
// A killed process writes nothing more and the kernel releases its lock, so a state `running` in an
// unlocked folder is that of a killed run. A resumed run writes the numbers of its checkpoint when
// it has restored it, and keeps its earlier scores until it has new ones. Any process may read
// result.json at any time, since it is only ever replaced as a whole. Value types; no thread rule.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "algorithms/base/learner.h"
#include "algorithms/run/run_ledger.h"
#include "algorithms/run/run_record.h"
#include "proto/base/status.h"
#include "proto/base/unique_fd.h"

namespace b4mrl {

enum class RunState {
  kRunning,
  kFinished,     // all updates done, or the score reached
  kInterrupted,  // told to stop
  kDiverged,     // a loss or weight is no longer finite
  kFailed,       // ended by any other error
  kKilled,       // never in the file: ReadRunStatus reports `running` without a lock as killed
};
// The state's name in result.json: "running", "finished", "interrupted", ...
std::string_view RunStateName(RunState state);

struct TrainSummary {
  RunState state = RunState::kRunning;
  std::string reason;  // why the run ended before its last update; otherwise ""
  DatasetIdentity dataset;
  uint64_t updates = 0;  // updates done so far
  uint64_t environment_steps = 0;
  RunUse use;
  std::optional<EvaluationResult> last;  // the last evaluation
  uint64_t last_updates = 0;             // of the agent that it scored
  // Means over the last ten evaluations, or over all evaluations if there are fewer.
  double mean_return_of_last_ten = 0;
  std::optional<double> mean_score_of_last_ten;
  std::string agent_path;  // "" if there is no file of the agent that `last` scored
};

// The content of result.json: one JSON object, without a newline.
std::string SummaryJson(const TrainOptions& options, const TrainSummary& summary);
// Writes result.json, atomically.
Status WriteResult(const TrainOptions& options, const TrainSummary& summary);
// Puts the scores of result.json into the summary if they are of a later evaluation: that of a
// run's last update is in no checkpoint where a longer run would not evaluate.
void TakeEarlierScores(const std::string& folder, TrainSummary* summary);
// Replaces the state and reason in result.json, atomically; scores already there are kept.
Status WriteResultState(const TrainOptions& options, RunState state, const std::string& reason);

// Locks the folder until the returned descriptor closes. kBusy if another process trains there.
Result<UniqueFd> LockRunFolder(const std::string& folder);

struct RunStatus {
  RunState state = RunState::kRunning;
  std::string reason;
  // When the state was written: for a killed run, where its session began or was resumed.
  uint64_t updates = 0;
};
// Reads result.json without locking out a training. kIoError if the folder has no result.json: no
// run, or a run killed before it began. kDataLoss if result.json cannot be parsed.
Result<RunStatus> ReadRunStatus(const std::string& folder);

}  // namespace b4mrl
