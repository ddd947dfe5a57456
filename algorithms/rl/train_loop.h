// The loop around every learner: updates, evaluations, logs, checkpoints, the end.
//
// A run lives in one folder:
//   run.json        what was asked (rl/run_record.h)       agent.h5      the policy last evaluated
//   progress.csv, metrics.jsonl   (rl/metrics.h)           checkpoint-<update>.h5, the newest two
//   result.json     the scores, once it has ended          replay.bin    online learners only
//   ensemble.h5     the model of MOPO and HyMOPO (rl/ensemble_training.h)
// An evaluation is `eval_episodes` deterministic episodes on the true environment, of the agent
// file's own policy. A checkpoint follows every row it counts on, so that a run resumed after a
// kill writes the same rows again. Thread rule: one thread, one run per folder (a lock refuses a
// second).
#pragma once

#include <atomic>
#include <optional>
#include <string>

#include "algorithms/rl/evaluate.h"
#include "algorithms/rl/progress.h"
#include "algorithms/rl/run_record.h"
#include "proto/base/status.h"

namespace b4mrl {

class Client;

struct TrainSummary {
  uint64_t updates = 0;
  uint64_t environment_steps = 0;
  bool interrupted = false;              // `stop` was set; the run can be resumed
  std::optional<EvaluationResult> last;  // the last evaluation
  // Means over the last ten evaluations, or all if there were fewer.
  double mean_return_of_last_ten = 0;
  std::optional<double> mean_score_of_last_ten;
  std::string agent_path;
};

// The summary as one JSON object: what result.json holds.
std::string SummaryJson(const TrainOptions& options, const TrainSummary& summary);

// `stop`, set by a signal handler, ends the run after the present update with a checkpoint.
Result<TrainSummary> Train(const TrainOptions& options, Client& client, Progress& progress,
                           const std::atomic<bool>& stop);

}  // namespace b4mrl
