// Trains the runs of a plan: makes the datasets that they need, starts learners side by side, and
// keeps their results.
//
//   DIR/runs/<name>-<first 8 digits of the id>/   a run: what `b4mrl train` writes, its claim, its
//                                                 log, failed.json if it diverged
//   DIR/datasets/<name>.claim                     held while a dataset is made
//   RESULTS/<name>-<id>.json                      a result (result_file.h)
//
// Any number of runners may share a folder, and may be killed at any moment: what is claimed is
// left to its holder, what was begun is resumed, what has its result is not trained again. An
// interrupt (client/interrupt.h) stops the learners in order. Runs that cannot end within the hours
// are begun when none is left that can. Thread rule: one thread.
#pragma once

#include <cstdint>
#include <deque>
#include <list>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "algorithms/run/run_result.h"
#include "benchmarks/jobs/job.h"
#include "benchmarks/plan/budget.h"
#include "benchmarks/plan/plan.h"
#include "benchmarks/records/result_file.h"
#include "benchmarks/runner/cost.h"
#include "benchmarks/runner/dataset_jobs.h"
#include "benchmarks/runner/progress_line.h"
#include "client/client.h"
#include "proto/base/clock.h"
#include "proto/base/status.h"

namespace b4mrl {

struct RunnerOptions {
  std::string folder;          // DIR
  std::string results;         // RESULTS
  std::string data_folder;     // of the daemon, where datasets are and are made
  std::string endpoint;        // of the daemon for all processes; "": each has a private one
  std::string suites;          // folder of further suites, for learners of the user's own
  std::string commit;          // of this program; "" if it is not known
  uint32_t jobs = 1;           // processes at a time
  double hours = 0;            // after which the work stops, to be resumed; 0: no limit
  uint32_t until_settled = 0;  // how often a run that is not settled goes on for its updates again
  bool retry = false;          // begin diverged runs anew
  bool quiet = false;          // no lines about runs on stderr
};

// Options of a command that make it use the runner's daemon, or the data of a private one of its
// own.
inline std::vector<std::string> DaemonWordsOf(const RunnerOptions& options) {
  if (!options.endpoint.empty()) return {"--endpoint", options.endpoint};
  return {"--data", options.data_folder};
}

struct RunnerSummary {
  size_t done = 0;                  // runs with a result, earlier ones included
  std::vector<std::string> failed;  // "<name>: <reason>"
  size_t left = 0;                  // that were not begun or not finished for want of time
  bool interrupted = false;
};

class Runner {
 public:
  // `client` is connected to a daemon on options.data_folder; all references outlive the runner.
  Runner(const RunnerOptions& options, const Budget& budget, std::vector<PlannedRun>& plan,
         Client& client);

  // Makes the folders and works until nothing is left to do. An error is one of the folders, or
  // kUnavailable: the daemon is gone.
  Result<RunnerSummary> Work();

 private:
  struct Task {
    PlannedRun* run = nullptr;
    std::string folder;
    uint64_t target = 0;   // updates to train for; run->updates, or more until it is settled
    uint64_t updates = 0;  // of its last evaluation
    bool ended = false;    // done or failed
    int attempts = 0;
    uint64_t written = 0;    // bytes of progress.csv when the result was last written
    std::string refused;     // why its result cannot be taken
    bool worked_on = false;  // by this runner
  };
  struct Active {
    Job job;
    std::optional<size_t> task;      // unset for a dataset
    std::string dataset;             // the full name, of a dataset's job
    std::optional<Scoring> scoring;  // of an evaluation's job
    uint64_t ledger = 0;             // of a user's learner
    // Of a user's learner, asked before it starts: its work is kept also if the daemon has ended.
    EnvironmentSpec environment;
    std::string columns_sha256 = "";  // of the dataset's rows as a user's learner begins
    Clock::time_point start = Clock::now();
  };

  bool Stops() const;  // whether the work ends now, to be resumed
  // Asks the daemon whether a request failed because it is gone: then the work ends, to be resumed.
  bool NoteIfLost(const Status& status);
  void LookAtResults();
  // Each starts a process, or finds that none is needed; false: the run has to wait.
  bool Begin(size_t number);  // a run that cannot be begun has failed
  Result<bool> TryToBegin(size_t number);
  Result<bool> BeginTraining(size_t number, UniqueFd claim);
  // The next evaluation of a trained agent that is missing. False: there is none.
  Result<bool> BeginMissingScoring(size_t number, const std::set<std::string>& present,
                                   UniqueFd& claim);
  Status BeginDataset(const PlannedRun& run);  // unless it is being made already
  Status BeginScoring(size_t number, const Scoring& scoring, UniqueFd claim);
  void End(Task& task);  // as done
  // Whether the run can probably end within the hours.
  bool FitsTheHours(const Task& task) const;
  void Collect();
  void Finish(Active& active, int exit_code);
  void FinishDataset(const Active& active, int exit_code);
  void FailDiverged(Task& task, const RunStatus& state);
  // Keeps what a job that ended with code 0 has left beside the run's own files.
  Status KeepWork(Active& active);
  // The run's result, if it has all updates that the task asks for.
  std::optional<RunResult> FinishedResult(const Task& task) const;
  // Whether the run's result holds what the job was to bring, so that it is not begun again.
  bool HasBrought(const Active& active) const;
  // Keeps what a user's learner has left.
  Status KeepUsersWork(Active& active);
  void WriteResults();
  // Sets task.refused if its dataset is not the one that it was planned for.
  Status WriteResult(Task& task);
  void Fail(Task& task, const std::string& reason);
  void Say(const std::string& line) { line_.Message(line); }
  void ShowProgress();
  double SecondsLeft(const Task& task) const;

  const RunnerOptions& options_;
  const Budget& budget_;
  Client& client_;
  std::vector<Task> tasks_;
  std::deque<size_t> waiting_;  // numbers of tasks, in plan order
  std::list<Active> active_;
  DatasetJobs datasets_;
  RunnerSummary summary_;
  Deadline end_;
  Status lost_;  // of the daemon
  CostModel costs_;
  ProgressLine line_;
  size_t done_before_ = 0;  // runs that were done when the work began
  Clock::time_point start_ = Clock::now();
};

}  // namespace b4mrl
