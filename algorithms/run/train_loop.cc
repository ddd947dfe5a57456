#include "algorithms/run/train_loop.h"

#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "algorithms/base/checkpoint.h"
#include "algorithms/base/within_memory.h"
#include "algorithms/list.h"
#include "algorithms/nn/products/blas.h"
#include "algorithms/run/check_opening.h"
#include "algorithms/run/check_training.h"
#include "algorithms/run/next_row.h"
#include "algorithms/run/run_ledger.h"
#include "algorithms/run/run_log.h"
#include "client/client.h"
#include "data/d4rl/agent_file.h"
#include "data/files/atomic_file.h"
#include "data/files/make_folder.h"

namespace b4mrl {
namespace {

// Whether an error says that the daemon may be gone; then nobody waits for its answers.
bool MayBeLost(const Status& status) {
  return status.code() == StatusCode::kUnavailable ||
         status.code() == StatusCode::kDeadlineExceeded;
}

class TrainRun {
 public:
  TrainRun(const TrainOptions& options, Client& client, Progress& progress,
           const std::atomic<bool>& stop)
      : options_(options), client_(client), progress_(progress), stop_(stop) {}

  // Called in this order, each after the success of the one before. An error of TakeFolder is about
  // another run.
  Status TakeFolder();
  Status Open();
  Status Run();
  // The summary of a run that ended with `status`, and the state after an error.
  TrainSummary Summary(const Status& status);
  RunState StateAfter(const Status& error) const;

 private:
  std::vector<RunSession> EarlierSessions() const;
  Status CreateLearner();
  Status RestoreNewest();
  Status Restore(uint64_t update);
  Status UpdateToTheEnd();
  Status Update();
  Status CheckFinite();
  Status Diverged(uint64_t update, std::string_view what);
  Status AfterUpdate();
  Status Record();
  Status Evaluate();
  Status Conclude();
  Status WriteRow(std::optional<EvaluationResult> evaluation);
  void RefreshLedger();
  Status Checkpoint();
  Status WriteCheckpoint();
  void KeepLastUpdate(const Status& error);
  bool ReachedScore() const;
  TrainSummary PresentSummary() const;
  double Seconds() const { return seconds_before_ + SecondsSince(start_); }
  Agent PresentAgent() const { return AgentOfRun(options_, context_, *learner_, update_); }

  const TrainOptions& options_;
  Client& client_;
  Progress& progress_;
  const std::atomic<bool>& stop_;
  UniqueFd lock_;
  bool resumes_ = false;
  LearnerContext context_;
  std::optional<RunLedger> ledger_;
  std::unique_ptr<Learner> learner_;
  std::optional<RunLog> log_;
  NextRow row_;
  uint64_t update_ = 0;
  std::optional<uint64_t> checkpoint_update_;  // update of the newest checkpoint
  bool is_prepared_ = false;                   // updates could begin
  bool diverged_ = false;
  double seconds_before_ = 0;               // seconds of earlier sessions of the run
  Clock::time_point start_ = Clock::now();  // start of this session, before its preparation
};

Status TrainRun::TakeFolder() {
  B4MRL_RETURN_IF_ERROR(MakeFolder(options_.folder));
  B4MRL_ASSIGN_OR_RETURN(lock_, LockRunFolder(options_.folder));
  B4MRL_RETURN_IF_ERROR(CheckEarlierRun(options_));
  B4MRL_ASSIGN_OR_RETURN(const auto checkpoints, ListCheckpoints(options_.folder));
  resumes_ = options_.resume && !checkpoints.empty();
  return resumes_ ? WriteResultState(options_, RunState::kRunning, "")
                  : WriteResult(options_, TrainSummary());
}

Status TrainRun::Open() {
  UseOneBlasThread();
  B4MRL_RETURN_IF_ERROR(CreateLearner());
  B4MRL_ASSIGN_OR_RETURN(log_, RunLog::Open(options_, client_, progress_));
  // A model that an earlier session has begun to train goes on without a checkpoint, too.
  std::error_code error;
  const bool has_model = std::filesystem::exists(options_.folder + "/ensemble.h5", error);
  std::vector<RunSession> earlier;
  if (resumes_ || has_model) earlier = EarlierSessions();
  B4MRL_RETURN_IF_ERROR(WriteRunRecord(options_, earlier));
  B4MRL_RETURN_IF_ERROR(WriteRunConfiguration(options_));
  return resumes_ ? RestoreNewest() : log_->Begin();
}

// The earlier sessions of a run that goes on. An unreadable record gives none: callers that need
// the record have reported it. Without a checkpoint the folder's record may be of another run.
std::vector<RunSession> TrainRun::EarlierSessions() const {
  const Result<RunRecord> record = ReadRunRecord(options_.folder);
  if (!record.ok() || record->sessions.empty()) return {};
  if (!resumes_ && !IsRecordOf(*record, options_)) return {};
  const RunSession &last = record->sessions.back(), present = PresentSession();
  if (!last.ComputesAs(present)) {
    progress_.Message(
        fmt::format("the run was last computed by {}, now by {}: from here on its numbers may "
                    "differ from an uninterrupted run's",
                    last.Text(), present.Text()));
  }
  return record->sessions;
}

Status TrainRun::CreateLearner() {
  B4MRL_ASSIGN_OR_RETURN(const Algorithm* algorithm, FindAlgorithm(options_.algorithm));
  B4MRL_ASSIGN_OR_RETURN(context_.environment, client_.FindEnvironment(options_.environment));
  B4MRL_ASSIGN_OR_RETURN(context_.simulator, ParseNamedArguments(options_.simulator));
  B4MRL_ASSIGN_OR_RETURN(context_.corruption, ParseNamedArguments(options_.corruption));
  context_.corruption_seed = options_.corruption_seed;
  context_.transitions = options_.transitions;
  context_.client = &client_;
  context_.dataset = options_.dataset;
  context_.history_length = options_.history_length;
  context_.seed = options_.seed;
  context_.folder = options_.folder;
  context_.threads = options_.threads;
  context_.precision = options_.precision;
  context_.stop = &stop_;
  context_.hyperparameters = options_.hyperparameters;
  B4MRL_RETURN_IF_ERROR(CheckTraining(options_, context_.environment));
  if (!ledger_) ledger_.emplace(client_);
  context_.ledger = ledger_->learner();
  B4MRL_ASSIGN_OR_RETURN(learner_, algorithm->create(context_));
  return Status();
}

// Restores the newest checkpoint that is not damaged. Newer ones would take its place among those
// kept. What fails for another reason, such as a full disk, may do with the same one next time.
Status TrainRun::RestoreNewest() {
  B4MRL_ASSIGN_OR_RETURN(const auto checkpoints, ListCheckpoints(options_.folder));
  Status status;
  for (const uint64_t update : checkpoints) {
    status = Restore(update);
    if (status.ok()) {
      progress_.Message(fmt::format("resumed at update {}", update));
      SetAsideCheckpointsAfter(update, options_.folder);
      const TrainSummary restored = PresentSummary();
      log_->RemoveLaterAgent(restored);
      return WriteResult(options_, restored);
    }
    progress_.Message(fmt::format("cannot resume at update {}: {}", update, status.ToString()));
    if (status.code() != StatusCode::kDataLoss) return status;
    B4MRL_RETURN_IF_ERROR(CreateLearner());  // a failed Restore may have loaded a part
  }
  return status;
}

// kDataLoss for whatever is wrong with the file, kIoError where it cannot be opened.
Status TrainRun::Restore(uint64_t update) {
  auto opened = CheckpointReader::Open(CheckpointPath(options_.folder, update));
  if (opened.status().code() == StatusCode::kIoError) return opened.status();
  if (!opened.ok()) return Status(StatusCode::kDataLoss, opened.status().message());
  CheckpointReader& reader = *opened;
  update_ = reader.Unsigned("run/update");
  if (reader.status().ok() && update_ != update) {
    return Status(StatusCode::kDataLoss, fmt::format("the file is of update {}", update_));
  }
  seconds_before_ = reader.Number("run/seconds");
  row_.Load(reader, update_, seconds_before_);
  Status loaded = reader.status().ok() ? learner_->Load(reader) : reader.status();
  if (loaded.ok()) {
    ledger_->Load(reader);
    loaded = log_->Load(reader);
  }
  if (!reader.status().ok()) return Status(StatusCode::kDataLoss, reader.status().message());
  if (loaded.ok()) checkpoint_update_ = update_;
  return loaded;
}

Status TrainRun::Run() {
  start_ = Clock::now();
  if (!resumes_) {
    B4MRL_RETURN_IF_ERROR(learner_->Prepare(progress_));
    if (stop_) return Status();  // Prepare may have returned early
    seconds_before_ = learner_->seconds_taken_up();
    row_.Begin(0, Seconds());
    B4MRL_RETURN_IF_ERROR(Checkpoint());
  }
  is_prepared_ = true;
  const Status status = UpdateToTheEnd();
  if (!status.ok()) KeepLastUpdate(status);
  progress_.Finish();
  return status;
}

Status TrainRun::UpdateToTheEnd() {
  if (update_ < options_.updates) B4MRL_RETURN_IF_ERROR(Record());  // a run ended here before
  progress_.Start("train", "updates", options_.updates, update_);
  while (update_ < options_.updates && !ReachedScore() && !stop_) {
    B4MRL_RETURN_IF_ERROR(Update());
    progress_.Update(update_);
    B4MRL_RETURN_IF_ERROR(AfterUpdate());
  }
  if (checkpoint_update_ != update_) B4MRL_RETURN_IF_ERROR(Checkpoint());
  return update_ < options_.updates ? Status() : Conclude();
}

// An error of the learner may be caused by metrics or actions that are not finite: then the reason
// reported is divergence.
Status TrainRun::Update() {
  const Status status = learner_->Update(row_.means());
  B4MRL_RETURN_IF_ERROR(CheckFinite());
  if (status.ok()) {
    ++update_;
    return status;
  }
  const Status policy = PresentAgent().Validate();
  return policy.ok() ? status : Diverged(update_, policy.message());
}

Status TrainRun::CheckFinite() {
  const auto& metric = row_.means().first_nonfinite();
  if (!metric) return Status();
  return Diverged(update_ + 1, fmt::format("{} became {}", metric->name, metric->value));
}

// Ends a run that diverged, since it would not recover; names its last good checkpoint.
Status TrainRun::Diverged(uint64_t update, std::string_view what) {
  diverged_ = true;
  const std::string left =
      checkpoint_update_
          ? "the last good state is " + CheckpointPath(options_.folder, *checkpoint_update_)
          : "there is no good state before";
  return Status(StatusCode::kFailedPrecondition,
                fmt::format("the run diverged: {} at update {}; {}", what, update, left));
}

Status TrainRun::AfterUpdate() {
  const bool last = update_ == options_.updates;
  // Conclude evaluates a last update that a longer run would not.
  if (!last || update_ % options_.eval_every == 0) B4MRL_RETURN_IF_ERROR(Record());
  if (last || ReachedScore() || update_ % options_.checkpoint_every == 0) return Checkpoint();
  return Status();
}

// Writes the present update's row, with an evaluation if due, unless the row has been written.
Status TrainRun::Record() {
  if (row_.Follows(update_)) return Status();
  if (update_ % options_.eval_every == 0) return Evaluate();
  if (update_ % options_.log_every == 0) return WriteRow(std::nullopt);
  return Status();
}

Status TrainRun::Evaluate() {
  const Agent agent = PresentAgent();
  if (Status policy = agent.Validate(); !policy.ok()) return Diverged(update_, policy.message());
  B4MRL_ASSIGN_OR_RETURN(EvaluationResult result, log_->Evaluate(agent, ledger_->evaluations()));
  RefreshLedger();
  return WriteRow(std::move(result));
}

// Evaluates the last update if it has no evaluation. Checkpoints do not store this evaluation. A
// row alone is none: a longer run, of which this is the end now, wrote it, or one that evaluated at
// other updates.
Status TrainRun::Conclude() { return log_->HasEvaluated(update_) ? Status() : Evaluate(); }

// Writes the present update's row, with its evaluation if there is one.
Status TrainRun::WriteRow(std::optional<EvaluationResult> evaluation) {
  const double seconds = Seconds();
  MetricRow row = row_.At(update_, seconds, learner_->environment_steps());
  B4MRL_RETURN_IF_ERROR(evaluation
                            ? log_->Write(std::move(row), *std::move(evaluation), ledger_->use())
                            : log_->Write(row));
  row_.Begin(update_, seconds);
  return Status();
}

// Sessions that the learner opens later name the ledger that there is now.
void TrainRun::RefreshLedger() {
  ledger_->Refresh();
  context_.ledger = ledger_->learner();
}

Status TrainRun::Checkpoint() {
  RefreshLedger();
  return WriteCheckpoint();
}

Status TrainRun::WriteCheckpoint() {
  B4MRL_ASSIGN_OR_RETURN(CheckpointWriter writer,
                         CheckpointWriter::Create(CheckpointPath(options_.folder, update_)));
  writer.Unsigned("run/update", update_);
  writer.Number("run/seconds", Seconds());
  row_.Save(writer);
  ledger_->Save(writer);
  B4MRL_RETURN_IF_ERROR(log_->Save(writer));
  B4MRL_RETURN_IF_ERROR(learner_->Save(writer));
  if (writer.first_nonfinite()) {
    return Diverged(update_, fmt::format("{} was not finite", *writer.first_nonfinite()));
  }
  B4MRL_RETURN_IF_ERROR(writer.Commit());
  checkpoint_update_ = update_;
  RemoveOldCheckpoints(options_.folder);
  return Status();
}

// Writes a checkpoint after an error, without asking a daemon that may be gone. If that fails, too,
// the checkpoint before it remains.
void TrainRun::KeepLastUpdate(const Status& error) {
  if (diverged_ || checkpoint_update_ == update_ || !learner_->outlives_daemon()) return;
  if (!MayBeLost(error)) RefreshLedger();
  if (WriteCheckpoint().ok())
    progress_.Message(fmt::format("kept what there is at update {}", update_));
}

// Only the present update's evaluation counts: a score asked for on resuming may be below that of
// an earlier one.
bool TrainRun::ReachedScore() const {
  if (!options_.stop_at_score || !log_->HasEvaluated(update_)) return false;
  const std::optional<double>& score = log_->evaluations().back().score;
  return score && *score >= *options_.stop_at_score;
}

// The summary of a run that goes on.
TrainSummary TrainRun::PresentSummary() const {
  TrainSummary summary;
  summary.dataset = learner_->dataset_identity();
  summary.updates = update_;
  summary.environment_steps = learner_->environment_steps();
  summary.use = ledger_->use();
  log_->Summarise(context_.environment, &summary);
  return summary;
}

RunState TrainRun::StateAfter(const Status& error) const {
  if (diverged_) return RunState::kDiverged;
  // A wait for the daemon can be interrupted, too.
  return stop_ && MayBeLost(error) ? RunState::kInterrupted : RunState::kFailed;
}

TrainSummary TrainRun::Summary(const Status& status) {
  // The last checkpoint of a run without an error has refreshed the ledger, if there was one.
  if (!MayBeLost(status) && !(status.ok() && is_prepared_)) RefreshLedger();
  TrainSummary summary = PresentSummary();
  if (!status.ok()) {
    summary.state = StateAfter(status);
    summary.reason = status.ToString();
  } else if (is_prepared_ && update_ >= options_.updates) {
    summary.state = RunState::kFinished;
  } else if (ReachedScore()) {
    summary.state = RunState::kFinished;
    summary.reason = fmt::format("the score asked for, {}, was reached", *options_.stop_at_score);
  } else {
    summary.state = RunState::kInterrupted;
    summary.reason = "told to stop";
  }
  return summary;
}

}  // namespace

Result<TrainSummary> Train(const TrainOptions& options, Client& client, Progress& progress,
                           const std::atomic<bool>& stop) {
  constexpr std::string_view kPurpose = "these networks, batch and data";
  TrainRun run(options, client, progress, stop);
  B4MRL_RETURN_IF_ERROR(CheckOpening(options, client));
  B4MRL_RETURN_IF_ERROR(run.TakeFolder());
  if (const Status status = WithinMemory(kPurpose, [&] { return run.Open(); }); !status.ok()) {
    // Report Open's error, even if result.json cannot be written and goes on saying "running".
    static_cast<void>(WriteResultState(options, run.StateAfter(status), status.ToString()));
    return status;
  }
  const Status status = WithinMemory(kPurpose, [&] { return run.Run(); });
  const TrainSummary summary = run.Summary(status);
  const Status written = WriteResult(options, summary);
  B4MRL_RETURN_IF_ERROR(status);
  B4MRL_RETURN_IF_ERROR(written);
  return summary;
}

}  // namespace b4mrl
