// A run's rows in the order of their updates, and the evaluations that belong to some of them.
//
// An evaluation runs beside the training, in a process of its own (rl/evaluation_process.h), on the
// agent file of its update. Its row, and those that come after, are held back until it has ended,
// so that the logs are the same whenever that is. At most one is under way: the next one first
// waits for it. What is held back is part of a checkpoint, the agent file included, so that a
// resumed run evaluates the same agent again. An evaluation whose process fails is done here.
// Thread rule: one thread. Errors: the daemon's and those of the files.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "algorithms/base/checkpoint.h"
#include "algorithms/base/progress.h"
#include "algorithms/episodes/evaluate.h"
#include "algorithms/run/evaluation_process.h"
#include "algorithms/run/metrics_log.h"
#include "algorithms/run/run_record.h"
#include "data/d4rl/agent_file.h"
#include "proto/base/status.h"

namespace b4mrl {

class Client;

class RunLog {
 public:
  // All three outlive the log. Asks the daemon whether the evaluations can be done.
  static Result<RunLog> Open(const TrainOptions& options, Client& client, Progress& progress);

  // Before the first row: new files, or those that the checkpoint names.
  Status Begin();
  Status Load(CheckpointReader& reader);

  // A row starts with {"update", ...}.
  Status Write(MetricRow row);
  // Writes the agent file, starts its evaluation and holds `row` until that has ended.
  Status Evaluate(const Agent& agent, MetricRow row);
  // Takes the result of an evaluation that has ended by now.
  Status Poll();
  // Waits for the evaluation under way, if any.
  Status Wait();

  Status Save(CheckpointWriter& writer);

  std::string AgentPath() const { return options_->folder + "/agent.h5"; }
  // Of the evaluations that have ended, the newest ten.
  const std::vector<EvaluationResult>& evaluations() const { return evaluations_; }

 private:
  RunLog(const TrainOptions& options, Client& client, Progress& progress, Evaluator evaluator)
      : options_(&options),
        client_(&client),
        progress_(&progress),
        evaluator_(std::move(evaluator)) {}

  Status StartEvaluation();
  Result<EvaluationResult> EvaluateHere();
  // Completes the first row that is held, and writes all of them.
  Status Take(EvaluationResult result);

  const TrainOptions* options_;
  Client* client_;
  Progress* progress_;
  Evaluator evaluator_;
  std::optional<MetricsLog> log_;
  std::optional<EvaluationProcess> process_;
  std::vector<MetricRow> held_;                // the first one awaits its evaluation
  std::vector<EvaluationResult> evaluations_;  // the newest ones
};

}  // namespace b4mrl
