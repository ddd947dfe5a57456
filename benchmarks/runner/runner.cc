#include "benchmarks/runner/runner.h"

#include <fmt/format.h>
#include <poll.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <system_error>
#include <utility>

#include "algorithms/run/run_result.h"
#include "benchmarks/runner/evaluation_job.h"
#include "benchmarks/runner/job_queue.h"
#include "client/interrupt.h"
#include "data/files/atomic_file.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

constexpr int kMostAttempts = 2;  // of a run that ends with an error
constexpr size_t kShortId = 8;    // digits of the id in the name of a run's folder

Status MakeFolder(const std::string& path) {
  std::error_code error;
  fs::create_directories(path, error);
  return error ? IoError("make", path, error.value()) : Status();
}

// A name of a dataset as one of a file: "HalfCheetah-medium".
std::string FileNameOf(std::string dataset) {
  std::ranges::replace(dataset, '/', '-');
  return dataset;
}

// Removes what only a run that goes on needs.
void RemoveTraining(const std::string& folder) {
  std::error_code ignored;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, ignored)) {
    const std::string name = entry.path().filename();
    const bool heavy =
        name == "replay.bin" || name == "ensemble.h5" || name.starts_with("checkpoint-");
    if (heavy) fs::remove(entry.path(), ignored);
  }
}

}  // namespace

Runner::Runner(const RunnerOptions& options, const Budget& budget,
               const std::vector<PlannedRun>& plan, Client& client)
    : options_(options),
      budget_(budget),
      client_(client),
      end_(Deadline::AfterMs(static_cast<int64_t>(options.hours * 3'600'000))) {
  for (const PlannedRun& run : plan) {
    waiting_.push_back(tasks_.size());
    tasks_.push_back(
        {&run, fmt::format("{}/runs/{}-{}", options.folder, run.name, run.id.substr(0, kShortId))});
  }
}

Result<RunnerSummary> Runner::Work() {
  for (const std::string& folder : {options_.folder + "/runs", options_.folder + "/datasets",
                                    options_.results, options_.data_folder}) {
    B4MRL_RETURN_IF_ERROR(MakeFolder(folder));
  }
  while (true) {
    B4MRL_RETURN_IF_ERROR(Collect());
    if (Interrupted()) break;
    const bool out_of_time = options_.hours > 0 && end_.expired();
    if (!out_of_time) {
      B4MRL_RETURN_IF_ERROR(BeginWaiting(
          waiting_, [this] { return active_.size() < options_.jobs; },
          [this](size_t number) { return Begin(number); }));
    }
    if (active_.empty() && (waiting_.empty() || out_of_time)) break;
    WriteResults();
    poll(nullptr, 0, kJobPollMs);
  }
  for (Active& active : active_) active.job.Stop();
  while (!active_.empty()) {
    B4MRL_RETURN_IF_ERROR(Collect());
    poll(nullptr, 0, kJobPollMs);
  }
  summary_.interrupted = Interrupted();
  summary_.left = tasks_.size() - summary_.done - summary_.failed.size();
  return summary_;
}

Result<bool> Runner::Begin(size_t number) {
  Task& task = tasks_[number];
  const PlannedRun& run = *task.run;
  B4MRL_RETURN_IF_ERROR(MakeFolder(task.folder));
  B4MRL_ASSIGN_OR_RETURN(UniqueFd claim, Claim(task.folder + "/claim"));
  if (!claim.valid()) return false;
  // Behind the claim, for another runner may have finished the run a moment ago.
  B4MRL_ASSIGN_OR_RETURN(const auto result, ReadResult(ResultPath(options_.results, run)));
  if (result && result->finished && result->updates >= run.updates) {
    // Where only the result is left, it stays as it is.
    std::error_code gone;
    const bool has_agent = fs::exists(task.folder + "/agent.h5", gone);
    for (const Scoring& scoring : run.scorings) {
      if (!has_agent || result->scorings.contains(scoring.name)) continue;
      return BeginScoring(number, scoring, std::move(claim));
    }
    ++summary_.done;
    RemoveTraining(task.folder);
    if (task.worked_on)
      Say(fmt::format("done  {} ({} of {})", run.name, summary_.done, tasks_.size()));
    return true;
  }
  const std::string failed = task.folder + "/failed.json";
  std::error_code error;
  if (fs::exists(failed, error)) {
    if (!options_.retry) {
      Fail(task, "diverged before; --retry begins it anew");
      return true;
    }
    fs::remove_all(task.folder, error);
    return false;
  }
  if (!run.dataset.empty()) {
    const auto broken = failed_datasets_.find(run.dataset);
    if (broken != failed_datasets_.end()) {
      Fail(task, broken->second);
      return true;
    }
    B4MRL_ASSIGN_OR_RETURN(const auto dataset, FindDataset(run.full_dataset));
    if (!dataset) return BeginDataset(run);
  }
  // The learner of a killed runner may still be about to end.
  if (const auto lock = LockRunFolder(task.folder); !lock.ok()) return false;
  B4MRL_ASSIGN_OR_RETURN(Job job, Job::Start("b4mrl-tools", TrainingWords(task),
                                             task.folder + "/log", std::move(claim)));
  Say(fmt::format("start {}", run.name));
  active_.push_back({std::move(job), number, "", std::nullopt});
  return true;
}

Result<bool> Runner::BeginScoring(size_t number, const Scoring& scoring, UniqueFd claim) {
  const Task& task = tasks_[number];
  const EvaluationOrder order = {.agent = task.folder + "/agent.h5",
                                 .environment = task.run->environment,
                                 .simulator = scoring.simulator,
                                 .observe = scoring.observe,
                                 .episodes = budget_.episodes,
                                 .data_folder = options_.data_folder};
  B4MRL_ASSIGN_OR_RETURN(
      Job job, StartEvaluation(order, ScoringPath(task.folder, scoring), std::move(claim)));
  active_.push_back({std::move(job), number, "", scoring});
  return true;
}

Result<bool> Runner::BeginDataset(const PlannedRun& run) {
  const std::string stem = fmt::format("{}/datasets/{}", options_.folder, FileNameOf(run.dataset));
  B4MRL_ASSIGN_OR_RETURN(UniqueFd claim, Claim(stem + ".claim"));
  if (!claim.valid()) return false;
  std::vector<std::string> words = {"dataset", "make",   run.full_dataset,
                                    "--quiet", "--data", options_.data_folder};
  if (budget_.rows) {
    words.insert(words.end(), {"--rows", fmt::format("{}", *budget_.rows)});
  }
  B4MRL_ASSIGN_OR_RETURN(Job job,
                         Job::Start("b4mrl-tools", words, stem + ".log", std::move(claim)));
  Say(fmt::format("make {}", run.dataset));
  active_.push_back({std::move(job), std::nullopt, run.dataset, std::nullopt});
  return false;  // the run waits for the dataset
}

Result<std::optional<UsedDataset>> Runner::FindDataset(const std::string& full_name) {
  B4MRL_ASSIGN_OR_RETURN(const auto listed, client_.ListDatasets());
  const auto found = std::ranges::find(listed, full_name, &pb::DatasetInfo::name);
  if (found == listed.end()) return std::optional<UsedDataset>();
  return std::optional(
      UsedDataset{found->name(), found->rows(), found->sha256(), found->columns_sha256()});
}

std::vector<std::string> Runner::TrainingWords(const Task& task) const {
  const PlannedRun& run = *task.run;
  const uint64_t every = std::max<uint64_t>(run.updates / budget_.evaluations, 1);
  std::vector<std::string> words = {"train", "--quiet", "--resume"};
  const auto add = [&](std::string_view name, const auto& value) {
    words.push_back(fmt::format("--{}", name));
    words.push_back(fmt::format("{}", value));
  };
  add("algorithm", run.algorithm);
  add("environment", run.environment);
  if (!run.simulator.empty()) add("simulator", run.simulator);
  if (!run.world.empty()) add("world", run.world);
  if (!run.dataset.empty()) add("dataset", run.full_dataset);
  if (!run.corruption.empty()) add("corruption", run.corruption);
  add("seed", run.seed);
  add("precision", run.precision);
  add("updates", run.updates);
  add("eval-every", every);
  add("eval-episodes", budget_.episodes);
  add("checkpoint-every", std::min<uint64_t>(every * 5, 10'000));
  add("threads", 1);
  for (const auto& [name, value] : run.hyperparameters) add(name, value);
  add("data", options_.data_folder);
  add("out", task.folder);
  return words;
}

Status Runner::Collect() {
  return CollectEnded(active_,
                      [this](Active& ended, int exit_code) { return Finish(ended, exit_code); });
}

Status Runner::Finish(Active& active, int exit_code) {
  if (!active.task) {
    if (exit_code != 0 && !Interrupted()) {
      failed_datasets_[active.dataset] =
          fmt::format("dataset {} could not be made, see {}/datasets/{}.log", active.dataset,
                      options_.folder, FileNameOf(active.dataset));
      Say(failed_datasets_[active.dataset]);
    }
    return Status();
  }
  Task& task = tasks_[*active.task];
  task.worked_on = true;
  if (active.scoring && exit_code == 0) {
    B4MRL_RETURN_IF_ERROR(KeepEvaluation(ScoringPath(task.folder, *active.scoring)));
  }
  if (Status status = WriteResult(task); !status.ok()) Say(status.message());
  if (!task.refused.empty()) {
    Fail(task, task.refused);
    return Status();
  }
  if (exit_code == 0) {
    waiting_.push_front(*active.task);  // to be scored, or found done
    return Status();
  }
  if (Interrupted()) return Status();
  const auto state = ReadRunStatus(task.folder);
  if (!active.scoring && state.ok() && state->state == RunState::kDiverged) {
    const nlohmann::json failed = {{"reason", state->reason}, {"updates", state->updates}};
    B4MRL_RETURN_IF_ERROR(WriteSmallFile(task.folder + "/failed.json", failed.dump() + "\n"));
    Fail(task, fmt::format("diverged: {}", state->reason));
  } else if (++task.attempts < kMostAttempts) {
    Say(fmt::format("{} ended with code {}; again later", task.run->name, exit_code));
    waiting_.push_back(*active.task);
  } else {
    Fail(task, fmt::format("ended with code {}, see {}/log", exit_code, task.folder));
  }
  return Status();
}

void Runner::WriteResults() {
  for (Active& active : active_) {
    if (!active.task || active.scoring || !tasks_[*active.task].refused.empty()) continue;
    if (Status status = WriteResult(tasks_[*active.task]); !status.ok()) Say(status.message());
    if (!tasks_[*active.task].refused.empty()) active.job.Stop();
  }
}

Status Runner::WriteResult(Task& task) {
  std::error_code error;
  const uint64_t bytes = fs::file_size(task.folder + "/progress.csv", error);
  if (error) return Status();  // nothing was logged yet
  const auto state = ReadRunStatus(task.folder);
  const bool ended = state.ok() && state->state == RunState::kFinished;
  if (bytes == task.written && !ended) return Status();
  std::optional<UsedDataset> dataset;
  if (!task.run->dataset.empty()) {
    B4MRL_ASSIGN_OR_RETURN(dataset, FindDataset(task.run->full_dataset));
  }
  const std::string& published = task.run->columns_sha256;
  if (dataset && !published.empty() && dataset->columns_sha256 != published) {
    task.refused = fmt::format(
        "{} in {} has {} rows that are not the published ones; make it again (b4mrl dataset make "
        "--replace), or choose another --data",
        dataset->name, options_.data_folder, dataset->rows);
    return Status();
  }
  B4MRL_RETURN_IF_ERROR(
      WriteResultOf(*task.run, task.folder, dataset, budget_.name, options_.results));
  task.written = bytes;
  return Status();
}

void Runner::Fail(const Task& task, const std::string& reason) {
  summary_.failed.push_back(fmt::format("{}: {}", task.run->name, reason));
  Say(fmt::format("fail  {}", summary_.failed.back()));
}

void Runner::Say(const std::string& line) const {
  if (!options_.quiet) fmt::print(stderr, "{}\n", line);
}

}  // namespace b4mrl
