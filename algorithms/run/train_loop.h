// The loop around every learner: updates, evaluations, logs, checkpoints, the end.
//
// A run lives in one folder:
//   run.json, config.toml     the run's options (run/run_record.h)
//   metrics.jsonl, progress.csv, events.out.tfevents.b4mrl     logs (run/metrics_log.h)
//   agent.h5                  the policy last evaluated
//   checkpoint-<update>.h5    the newest two checkpoints
//   replay.bin                experience of online learners and H2O (experience/replay_buffer.h)
//   ensemble.h5               the model of MOPO and HyMOPO (model/ensemble_store.h)
//   result.json               the run's state and scores, and lock (run/run_result.h)
// An evaluation is `eval_episodes` deterministic episodes of the present policy on the true
// environment, between two updates (run/run_log.h). A checkpoint is written only after the log rows
// before it are on disk; a resumed run therefore appends exactly the rows that are missing.
// The last update is evaluated in any case: where a longer run would not evaluate, the evaluation
// comes after the checkpoint, so that the run can be continued as if it had never ended. A run
// whose numbers are not finite ends with kFailedPrecondition, which names its last good checkpoint.
// Any other error ends the run too, after a checkpoint where the learner can give one
// (Learner::outlives_daemon).
// Thread rule: one thread, one run per folder (a lock refuses a second).
#pragma once

#include <atomic>

#include "algorithms/base/progress.h"
#include "algorithms/run/run_record.h"
#include "algorithms/run/run_result.h"
#include "proto/base/status.h"

namespace b4mrl {

class Client;

// `stop`, set by a signal handler, ends the run after the present update with a checkpoint. The
// returned state is kFinished or kInterrupted; a run that ended otherwise returns an error, and
// result.json holds its state.
Result<TrainSummary> Train(const TrainOptions& options, Client& client, Progress& progress,
                           const std::atomic<bool>& stop);

}  // namespace b4mrl
