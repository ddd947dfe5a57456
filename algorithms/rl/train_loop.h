// The loop around every learner: updates, evaluations, logs, checkpoints, the end.
//
// A run lives in one folder:
//   run.json, config.toml     what was asked (rl/run_record.h)
//   metrics.jsonl, progress.csv, events.out.tfevents.b4mrl     logs (rl/metrics_log.h)
//   agent.h5                  the policy last evaluated
//   checkpoint-<update>.h5    the newest two
//   replay.bin                online learners and H2O
//   ensemble.h5               the model of MOPO and HyMOPO (rl/ensemble_training.h)
//   result.json               the scores, once it has ended
// An evaluation is `eval_episodes` deterministic episodes on the true environment, of the agent
// file's own policy, beside the training (rl/run_log.h). The last one is waited for, and with
// `stop_at_score` each: whether there is another update is for its score to say. A checkpoint
// follows every row it counts on, so that a run resumed after a kill writes the same rows again. A
// run whose numbers are not finite ends with kFailedPrecondition, which names its last good
// checkpoint. Thread rule: one thread, one run per folder (a lock refuses a second).
#pragma once

#include <atomic>
#include <optional>
#include <string>

#include "algorithms/rl/evaluate.h"
#include "algorithms/rl/progress.h"
#include "algorithms/rl/run_record.h"
#include "proto/base/spec.h"
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

// What can be told of a run before anything is opened: kInvalidArgument, with the option's name,
// for more observations at once than an agent file holds, and for hyperparameters that do not go
// together or not with `environment`. Train checks it too.
Status CheckTraining(const TrainOptions& options, const EnvironmentSpec& environment);

// `stop`, set by a signal handler, ends the run after the present update with a checkpoint.
Result<TrainSummary> Train(const TrainOptions& options, Client& client, Progress& progress,
                           const std::atomic<bool>& stop);

}  // namespace b4mrl
