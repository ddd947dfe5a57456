// The rows of a run's logs, in the order of their updates, and the evaluations that belong to some
// of the rows.
//
// An evaluation runs in the training process, between two updates. Ten episodes of 1000 steps take
// about half a second, less than 1% of the 10,000 updates between two evaluations. An evaluation
// that fails leaves no trace here, so that a resumed run does it again.
// Thread rule: one thread. Errors: the daemon's and those of the files.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "algorithms/base/checkpoint.h"
#include "algorithms/base/learner.h"
#include "algorithms/base/progress.h"
#include "algorithms/episodes/evaluate.h"
#include "algorithms/run/metrics_log.h"
#include "algorithms/run/run_ledger.h"
#include "algorithms/run/run_record.h"
#include "algorithms/run/run_result.h"
#include "data/d4rl/agent_file.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

class Client;

// The agent of a run's learner after `updates` updates, with where it comes from.
Agent AgentOfRun(const TrainOptions& options, const LearnerContext& context, const Learner& learner,
                 uint64_t updates);

class RunLog {
 public:
  // `options`, `client` and `progress` outlive the log. Asks the daemon whether it can open the
  // sessions of the evaluations.
  static Result<RunLog> Open(const TrainOptions& options, Client& client, Progress& progress);

  // Before the first row, Begin creates new files, or Load cuts files to a checkpoint's lengths.
  Status Begin();
  Status Load(CheckpointReader& reader);
  Status Save(CheckpointWriter& writer);

  // Runs the agent's episodes, which the ledger of this number counts (0: none), and then writes
  // the agent's file: a failed evaluation leaves the file of the one before.
  Result<EvaluationResult> Evaluate(const Agent& agent, uint64_t ledger);
  // Writes a row without an evaluation. The row's first metric is {"update", ...}.
  Status Write(const MetricRow& row) { return log_->Write(row); }
  // Writes a row with the evaluation of its update and what the run has used until then, and shows
  // that evaluation as progress.
  Status Write(MetricRow row, EvaluationResult result, const RunUse& use);

  std::string AgentPath() const { return options_->folder + "/agent.h5"; }
  // The newest ten evaluations of the run, oldest first.
  const std::vector<EvaluationResult>& evaluations() const { return evaluations_; }
  // Whether the newest of them is of this update. Not known of one that is in a checkpoint of an
  // earlier version, which did not save it: false.
  bool HasEvaluated(uint64_t update) const {
    return !evaluations_.empty() && last_updates_ == update;
  }
  // Fills in the last evaluation and the means over these ten, if there are any. Scores that
  // result.json has of a later evaluation come first, unless an evaluation was made since the log
  // was opened. Names agent.h5 unless it has a later agent than the one that was scored.
  void Summarise(const EnvironmentSpec& environment, TrainSummary* summary) const;
  // Removes agent.h5 if it is readable and the summary does not name it. It is then of an
  // evaluation whose row is in no checkpoint, since the process was killed before; the run will do
  // that evaluation again.
  void RemoveLaterAgent(const TrainSummary& summary) const;

 private:
  RunLog(const TrainOptions& options, Progress& progress, Evaluator evaluator)
      : options_(&options), progress_(&progress), evaluator_(std::move(evaluator)) {}

  void Show(double update, const EvaluationResult& result);
  // Whether agent.h5 may be the agent that the summary's last evaluation has scored.
  bool HasAgentOf(const TrainSummary& summary) const;

  const TrainOptions* options_;
  Progress* progress_;
  Evaluator evaluator_;
  std::optional<MetricsLog> log_;
  std::vector<EvaluationResult> evaluations_;
  uint64_t last_updates_ = 0;   // of the agent that the last of them scored
  bool has_evaluated_ = false;  // since the log was opened
};

}  // namespace b4mrl
