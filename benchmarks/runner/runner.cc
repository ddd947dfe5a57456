#include "benchmarks/runner/runner.h"

#include <fmt/format.h>
#include <poll.h>

#include <algorithm>
#include <filesystem>
#include <system_error>
#include <utility>

#include "algorithms/base/checkpoint.h"
#include "algorithms/run/run_result.h"
#include "benchmarks/jobs/evaluation_job.h"
#include "benchmarks/jobs/job_queue.h"
#include "benchmarks/jobs/training_order.h"
#include "benchmarks/records/learned.h"
#include "benchmarks/runner/learners_use.h"
#include "benchmarks/runner/plan_status.h"
#include "benchmarks/runner/run_folder.h"
#include "client/interrupt.h"
#include "data/files/make_folder.h"

namespace b4mrl {

namespace fs = std::filesystem;

Runner::Runner(const RunnerOptions& options, const Budget& budget, std::vector<PlannedRun>& plan,
               Client& client)
    : options_(options),
      budget_(budget),
      client_(client),
      datasets_(client, {options.folder, options.data_folder, DaemonWordsOf(options),
                         budget.rows.has_value()}),
      end_(Deadline::AfterMs(static_cast<int64_t>(options.hours * 3'600'000))),
      line_(options.quiet) {
  for (PlannedRun& run : plan) {
    waiting_.push_back(tasks_.size());
    tasks_.push_back(
        {.run = &run, .folder = RunFolder(options.folder, run), .target = run.updates});
  }
}

Result<RunnerSummary> Runner::Work() {
  for (const std::string& folder :
       {options_.folder + "/runs", options_.folder + "/datasets", options_.results}) {
    B4MRL_RETURN_IF_ERROR(MakeFolder(folder));
  }
  LookAtResults();
  for (Patience patience; true;) {
    Collect();
    if (Stops() || (active_.empty() && waiting_.empty())) break;
    const bool tries = patience.IsOver(active_.size(), waiting_.size());
    // Those that can end within the hours come first.
    for (const bool takes_all : {false, true}) {
      if (!tries || (takes_all && options_.hours <= 0)) break;
      BeginWaiting(
          waiting_, [this] { return active_.size() < options_.jobs && !Stops(); },
          [&](size_t number) {
            if (!takes_all && !FitsTheHours(tasks_[number])) return false;
            return Begin(number);
          });
    }
    WriteResults();
    ShowProgress();
    poll(nullptr, 0, kJobPollMs);
  }
  StopAll(active_, [this](Active& ended, int exit_code) { Finish(ended, exit_code); });
  line_.Show("");
  B4MRL_RETURN_IF_ERROR(lost_);
  summary_.interrupted = Interrupted();
  summary_.left = tasks_.size() - summary_.done - summary_.failed.size();
  return summary_;
}

bool Runner::Stops() const {
  return Interrupted() || !lost_.ok() || (options_.hours > 0 && end_.expired());
}

bool Runner::NoteIfLost(const Status& status) {
  if (status.recoverable() && !client_.ServerStatus().ok()) lost_ = status;
  return !lost_.ok();
}

void Runner::LookAtResults() {
  for (Task& task : tasks_) {
    const auto result = ReadResult(ResultPath(options_.results, *task.run));
    if (!result.ok() || !*result) continue;  // Begin reports what cannot be read
    task.updates = (*result)->updates;
    task.target = UpdatesToTrain(*task.run, *result, options_.until_settled);
    costs_.Learn(*task.run, **result);
  }
}

double Runner::SecondsLeft(const Task& task) const {
  if (task.ended || task.updates >= task.target) return 0;
  return costs_.SecondsOf(*task.run, static_cast<double>(task.target - task.updates));
}

bool Runner::FitsTheHours(const Task& task) const {
  if (options_.hours <= 0) return true;
  return SecondsLeft(task) * 1000 < static_cast<double>(end_.remaining_ms());
}

void Runner::ShowProgress() {
  SuiteProgress progress = {.done = summary_.done,
                            .failed = summary_.failed.size(),
                            .runs = tasks_.size(),
                            .done_meanwhile = summary_.done - done_before_,
                            .hours = SecondsSince(start_) / 3600};
  for (const Active& active : active_) progress.running += active.task ? 1 : 0;
  for (const Task& task : tasks_) progress.seconds_left += SecondsLeft(task) / options_.jobs;
  line_.Show(TextOf(progress));
}

bool Runner::Begin(size_t number) {
  const Result<bool> begun = TryToBegin(number);
  if (begun.ok()) return *begun;
  if (Stops() || NoteIfLost(begun.status())) return false;  // requests end with the work
  Fail(tasks_[number], begun.status().message());
  return true;
}

Result<bool> Runner::TryToBegin(size_t number) {
  Task& task = tasks_[number];
  const PlannedRun& run = *task.run;
  B4MRL_RETURN_IF_ERROR(MakeFolder(task.folder));
  B4MRL_ASSIGN_OR_RETURN(UniqueFd claim, Claim(task.folder + "/claim"));
  if (!claim.valid()) return false;
  // Behind the claim, for another runner may have finished the run a moment ago.
  B4MRL_ASSIGN_OR_RETURN(const auto result, ReadResult(ResultPath(options_.results, run)));
  task.target = UpdatesToTrain(run, result, options_.until_settled);
  if (result) task.updates = result->updates;
  if (result && result->IsDone(run, task.target)) {
    const Status named = NameAllBenchmarks(run, options_.results);
    if (!named.ok()) Say(named.message());
    for (const auto& line : DoneOtherwise(run, *result, task.folder, options_.results)) Say(line);
    // Where the result's agent is not left, the result stays as it is.
    if (HoldsAgentOf(*result, task.folder)) {
      std::set<std::string> present = result->scorings;
      present.insert(kOwnScoring);
      B4MRL_ASSIGN_OR_RETURN(const bool begun, BeginMissingScoring(number, present, claim));
      if (begun) return true;
    }
    End(task);
    return true;
  }
  if (IsMarkedDiverged(task.folder)) {
    if (!options_.retry) {
      Fail(task, "diverged before; --retry begins it anew");
      return true;
    }
    B4MRL_RETURN_IF_ERROR(RemoveDiverged(task.folder));
  }
  return BeginTraining(number, std::move(claim));
}

Result<bool> Runner::BeginTraining(size_t number, UniqueFd claim) {
  Task& task = tasks_[number];
  const PlannedRun& run = *task.run;
  std::string columns;
  if (!run.dataset.empty()) {
    if (const auto failure = datasets_.Failure(run.full_dataset)) {
      Fail(task, *failure);
      return true;
    }
    B4MRL_ASSIGN_OR_RETURN(const auto dataset, datasets_.FindCounted(run.full_dataset));
    if (!dataset) {  // which the run waits for
      B4MRL_RETURN_IF_ERROR(BeginDataset(run));
      return false;
    }
    if (const std::string refusal = datasets_.Refusal(run, *dataset); !refusal.empty()) {
      Fail(task, refusal);
      return true;
    }
    // The dataset may be another one than when the runner began.
    columns = task.run->rows_at_hand = dataset->columns_sha256;
  }
  RemoveFailure(task.folder);
  const bool has_learned = run.is_users() && HasLearned(run, task.folder, columns);
  if (!has_learned) RemoveScorings(run, task.folder);
  if (!run.is_users()) {
    // The learner of a killed runner may still be about to end. The lock is free again when the
    // next one begins.
    const Status is_free = LockRunFolder(task.folder).status();
    if (is_free.code() == StatusCode::kBusy) return false;
    B4MRL_RETURN_IF_ERROR(is_free);
    B4MRL_ASSIGN_OR_RETURN(const auto checkpoints, ListCheckpoints(task.folder));
    // A run that was stopped on its way to more updates ends where it is: it goes nowhere back.
    const uint64_t begun = checkpoints.empty() ? 0 : checkpoints.front();
    if (checkpoints.empty()) RemoveProgress(task.folder);
    const JobOrder order = TrainingOrder(run, budget_, std::max(task.target, begun), task.folder,
                                         DaemonWordsOf(options_));
    B4MRL_ASSIGN_OR_RETURN(Job job, Job::Start(order, std::move(claim)));
    active_.push_back({std::move(job), number, "", std::nullopt});
  } else if (has_learned) {  // before a runner was killed
    B4MRL_RETURN_IF_ERROR(WriteResult(task));
    if (!task.refused.empty()) {
      Fail(task, task.refused);
      return true;
    }
    if (HasAgent(task.folder)) return BeginMissingScoring(number, {}, claim);
    if (FinishedResult(task)) return false;  // which is seen when the run is looked at again
    SetLearnedAside(task.folder);            // it is to do more: it begins anew
    if (++task.attempts < kMostAttempts) return false;
    Fail(task, fmt::format("its learner has ended, but {} holds no result that counts",
                           ResultPath(options_.results, run)));
    return true;
  } else {
    SetLearnedAside(task.folder);  // of an attempt that failed, or of another command
    B4MRL_ASSIGN_OR_RETURN(EnvironmentSpec spec, client_.FindEnvironment(run.environment));
    B4MRL_ASSIGN_OR_RETURN(const uint64_t ledger, client_.OpenLedger());
    const LearnerPlace place = {client_.endpoint(), options_.suites, ledger};
    B4MRL_ASSIGN_OR_RETURN(Job job,
                           Job::Start(LearnerOrder(run, task.folder, place), std::move(claim)));
    active_.push_back({std::move(job), number, "", std::nullopt, ledger, std::move(spec), columns});
  }
  Say(fmt::format("start {}", run.name));
  return true;
}

Result<bool> Runner::BeginMissingScoring(size_t number, const std::set<std::string>& present,
                                         UniqueFd& claim) {
  for (const Scoring& scoring : tasks_[number].run->scorings) {
    if (present.contains(scoring.name)) continue;
    B4MRL_RETURN_IF_ERROR(BeginScoring(number, scoring, std::move(claim)));
    return true;
  }
  return false;
}

Status Runner::BeginScoring(size_t number, const Scoring& scoring, UniqueFd claim) {
  const Task& task = tasks_[number];
  const EvaluationOrder order = {.agent = task.folder + "/agent.h5",
                                 .environment = task.run->environment,
                                 .simulator = scoring.simulator,
                                 .observe = scoring.observe,
                                 .episodes = budget_.episodes,
                                 .daemon_words = DaemonWordsOf(options_)};
  B4MRL_ASSIGN_OR_RETURN(
      Job job, StartEvaluation(order, ScoringPath(task.folder, scoring), std::move(claim)));
  active_.push_back({std::move(job), number, "", scoring});
  return Status();
}

Status Runner::BeginDataset(const PlannedRun& run) {
  B4MRL_ASSIGN_OR_RETURN(std::optional<Job> job, datasets_.Begin(run));
  if (job) {
    Say(fmt::format("make {}", run.dataset));
    active_.push_back({*std::move(job), std::nullopt, run.full_dataset, std::nullopt});
  }
  return Status();
}

void Runner::Collect() {
  CollectEnded(active_, [this](Active& ended, int exit_code) { Finish(ended, exit_code); });
}

void Runner::FinishDataset(const Active& active, int exit_code) {
  if (Stops()) return;
  if (const auto failure = datasets_.Finish(active.dataset, exit_code)) Say(*failure);
}

void Runner::Finish(Active& active, int exit_code) {
  if (!active.task) return FinishDataset(active, exit_code);
  Task& task = tasks_[*active.task];
  task.worked_on = true;
  // A learner of the user's that was told to stop has not trained to its end, whatever it returns.
  const bool was_cut = task.run->is_users() && !active.scoring && active.job.was_stopped();
  const bool has_ended = exit_code == 0 && !was_cut;
  const Status kept = has_ended ? KeepWork(active) : Status();
  // A user's learner may go on from what it has, or from nothing.
  if (active.ledger != 0 && (!has_ended || !kept.ok())) {
    (void)KeepAttempt(*task.run, task.folder, UseOf(client_, active.ledger, active.start));
  }
  const Status written = kept.ok() ? WriteResult(task) : kept;
  if (!task.refused.empty()) return Fail(task, task.refused);
  if (exit_code == 0 && written.ok() && HasBrought(active)) {
    waiting_.push_front(*active.task);  // to be scored, or found done
    return;
  }
  if (Stops() || (!written.ok() && NoteIfLost(written))) return;
  if (!written.ok()) return Fail(task, written.message());
  const auto state = ReadRunStatus(task.folder);
  if (!active.scoring && state.ok() && state->state == RunState::kDiverged) {
    return FailDiverged(task, *state);
  }
  const std::string ended =
      fmt::format("ended with code {}{}", exit_code,
                  exit_code == 0 ? " and left less than it was to bring" : "");
  if (++task.attempts < kMostAttempts) {
    Say(fmt::format("{} {}; again later", task.run->name, ended));
    waiting_.push_back(*active.task);
  } else {
    const std::string log = active.scoring
                                ? LogOfEvaluation(ScoringPath(task.folder, *active.scoring))
                                : task.folder + "/log";
    Fail(task, fmt::format("{}, see {}", ended, log));
  }
}

void Runner::FailDiverged(Task& task, const RunStatus& state) {
  if (const Status written = MarkDiverged(task.folder, state); !written.ok()) {
    Say(written.message());
  }
  Fail(task, fmt::format("diverged: {}", state.reason));
}

Status Runner::KeepWork(Active& active) {
  const Task& task = tasks_[*active.task];
  if (active.scoring) return KeepEvaluation(ScoringPath(task.folder, *active.scoring));
  return task.run->is_users() ? KeepUsersWork(active) : Status();
}

std::optional<RunResult> Runner::FinishedResult(const Task& task) const {
  auto result = ReadResult(ResultPath(options_.results, *task.run));
  if (!result.ok() || !*result || !(*result)->IsDone(*task.run, task.target)) return std::nullopt;
  return **std::move(result);
}

bool Runner::HasBrought(const Active& active) const {
  const Task& task = tasks_[*active.task];
  if (task.run->is_users() && !active.scoring) {
    return HasLearned(*task.run, task.folder, active.columns_sha256);
  }
  const auto result = FinishedResult(task);
  if (!result) return false;
  const bool is_further = active.scoring && active.scoring->name != kOwnScoring;
  return !is_further || result->scorings.contains(active.scoring->name);
}

Status Runner::KeepUsersWork(Active& active) {
  const Task& task = tasks_[*active.task];
  LearnersUse use = UseOf(client_, active.ledger, active.start);
  use.columns_sha256 = active.columns_sha256;
  B4MRL_ASSIGN_OR_RETURN(const std::string left_out,
                         KeepLearned(*task.run, task.folder, use, active.environment));
  if (!left_out.empty()) Say(fmt::format("{} has no curve: {}", task.run->name, left_out));
  return Status();
}

void Runner::WriteResults() {
  for (Active& active : active_) {
    if (!active.task || active.scoring || !tasks_[*active.task].refused.empty()) continue;
    if (tasks_[*active.task].run->is_users()) continue;  // it has a result when it ends
    if (Status status = WriteResult(tasks_[*active.task]); !status.ok()) Say(status.message());
    if (!tasks_[*active.task].refused.empty()) active.job.Stop();
  }
}

Status Runner::WriteResult(Task& task) {
  std::error_code error;
  const bool is_users = task.run->is_users();
  const uint64_t bytes = is_users ? 0 : fs::file_size(task.folder + "/progress.csv", error);
  if (error == std::errc::no_such_file_or_directory) return Status();  // nothing was logged yet
  if (error) return IoError("read", task.folder + "/progress.csv", error.value());
  const auto state = ReadRunStatus(task.folder);
  const bool ended =
      is_users ||
      (state.ok() && (state->state == RunState::kFinished || state->state == RunState::kDiverged));
  if (bytes == task.written && !ended) return Status();
  task.written = bytes;  // also of an attempt that fails, which is reported once
  B4MRL_ASSIGN_OR_RETURN(const auto dataset, datasets_.LearnedFrom(*task.run));
  if (dataset) task.refused = datasets_.Refusal(*task.run, *dataset);
  if (dataset && is_users &&
      LearnedRows(task.folder).value_or(dataset->columns_sha256) != dataset->columns_sha256) {
    task.refused = fmt::format("the rows of {} were replaced while it learned", dataset->name);
  }
  if (!task.refused.empty()) return Status();
  const ResultOrigin origin = {budget_.name, options_.commit, task.target};
  B4MRL_ASSIGN_OR_RETURN(task.updates,
                         WriteResultOf(*task.run, task.folder, dataset, origin, options_.results));
  B4MRL_ASSIGN_OR_RETURN(const auto written, ReadResult(ResultPath(options_.results, *task.run)));
  if (written && ended) costs_.Learn(*task.run, *written);
  return Status();
}

void Runner::End(Task& task) {
  task.ended = true;
  ++summary_.done;
  if (!task.run->is_users()) RemoveTraining(task.folder);
  if (task.worked_on) {
    Say(fmt::format("done  {} ({} of {})", task.run->name, summary_.done, tasks_.size()));
  } else {
    ++done_before_;
  }
}

void Runner::Fail(Task& task, const std::string& reason) {
  task.ended = true;
  summary_.failed.push_back(fmt::format("{}: {}", task.run->name, reason));
  KeepFailure(task.folder, reason);
  Say(fmt::format("fail  {}", summary_.failed.back()));
}

}  // namespace b4mrl
