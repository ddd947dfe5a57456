#include "benchmarks/runner/runner.h"

#include <fmt/format.h>
#include <poll.h>

#include <algorithm>
#include <charconv>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <system_error>
#include <utility>

#include "algorithms/run/run_result.h"
#include "client/interrupt.h"
#include "data/files/atomic_file.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

constexpr int kPollMs = 200;
constexpr int kMostAttempts = 2;         // of a run that ends with an error
constexpr size_t kShortId = 8;           // digits of the id in the name of a run's folder
constexpr size_t kMaxOutput = 16 << 20;  // bytes that an evaluation may print

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

// The version in "HalfCheetah/medium-v3" of a dataset "HalfCheetah/medium"; -1 for the name itself,
// none for other datasets.
std::optional<int> VersionOf(const std::string& found, const std::string& dataset) {
  if (found == dataset) return -1;
  const std::string stem = dataset + "-v";
  int version = 0;
  const char* last = found.data() + found.size();
  if (!found.starts_with(stem)) return std::nullopt;
  const auto [end, error] = std::from_chars(found.data() + stem.size(), last, version);
  if (error != std::errc() || end != last) return std::nullopt;
  return version;
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
    if (!out_of_time) B4MRL_RETURN_IF_ERROR(StartWhatCan());
    if (active_.empty() && (waiting_.empty() || out_of_time)) break;
    WriteResults();
    poll(nullptr, 0, kPollMs);
  }
  for (Active& active : active_) active.job.Stop();
  while (!active_.empty()) {
    B4MRL_RETURN_IF_ERROR(Collect());
    poll(nullptr, 0, kPollMs);
  }
  summary_.interrupted = Interrupted();
  summary_.left = tasks_.size() - summary_.done - summary_.failed.size();
  return summary_;
}

Status Runner::StartWhatCan() {
  std::deque<size_t> later;
  while (!waiting_.empty() && active_.size() < options_.jobs) {
    const size_t number = waiting_.front();
    waiting_.pop_front();
    B4MRL_ASSIGN_OR_RETURN(const Start start, Begin(number));
    if (start == Start::kLater) later.push_back(number);
  }
  waiting_.insert(waiting_.begin(), later.begin(), later.end());  // they keep their places
  return Status();
}

Result<Runner::Start> Runner::Begin(size_t number) {
  Task& task = tasks_[number];
  const PlannedRun& run = *task.run;
  B4MRL_RETURN_IF_ERROR(MakeFolder(task.folder));
  B4MRL_ASSIGN_OR_RETURN(UniqueFd claim, Claim(task.folder + "/claim"));
  if (!claim.valid()) return Start::kLater;
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
    return Start::kNothing;
  }
  const std::string failed = task.folder + "/failed.json";
  std::error_code error;
  if (fs::exists(failed, error)) {
    if (!options_.retry) {
      Fail(task, "diverged before; --retry begins it anew");
      return Start::kNothing;
    }
    fs::remove_all(task.folder, error);
    return Start::kLater;
  }
  if (!run.dataset.empty()) {
    const auto broken = failed_datasets_.find(run.dataset);
    if (broken != failed_datasets_.end()) {
      Fail(task, broken->second);
      return Start::kNothing;
    }
    B4MRL_ASSIGN_OR_RETURN(const bool is_there, HasDataset(run.dataset));
    if (!is_there) return BeginDataset(run.dataset);
  }
  // The learner of a killed runner may still be about to end.
  if (const auto lock = LockRunFolder(task.folder); !lock.ok()) return Start::kLater;
  B4MRL_ASSIGN_OR_RETURN(Job job, Job::Start("b4mrl-tools", TrainingWords(task),
                                             task.folder + "/log", std::move(claim)));
  Say(fmt::format("start {}", run.name));
  active_.push_back({std::move(job), number, "", std::nullopt});
  return Start::kStarted;
}

Result<Runner::Start> Runner::BeginScoring(size_t number, const Scoring& scoring, UniqueFd claim) {
  const Task& task = tasks_[number];
  std::vector<std::string> words = {"evaluate",      "--json",
                                    "--agent",       task.folder + "/agent.h5",
                                    "--environment", task.run->environment,
                                    "--episodes",    fmt::format("{}", budget_.episodes),
                                    "--observe",     scoring.observe,
                                    "--data",        options_.data_folder};
  if (!scoring.simulator.empty()) words.insert(words.end(), {"--simulator", scoring.simulator});
  const std::string log = ScoringPath(task.folder, scoring) + ".log";
  std::error_code ignored;
  fs::remove(log, ignored);  // of an earlier attempt
  B4MRL_ASSIGN_OR_RETURN(Job job, Job::Start("b4mrl-tools", words, log, std::move(claim)));
  active_.push_back({std::move(job), number, "", scoring});
  return Start::kStarted;
}

// Makes the evaluation's output the file that results are read from; its last line is the JSON.
Status Runner::FinishScoring(const Task& task, const Scoring& scoring) const {
  const std::string path = ScoringPath(task.folder, scoring);
  B4MRL_ASSIGN_OR_RETURN(std::string text, ReadSmallFile(path + ".log", kMaxOutput));
  while (text.ends_with('\n')) text.pop_back();
  B4MRL_ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::Create(path));
  const size_t line = text.rfind('\n');
  B4MRL_RETURN_IF_ERROR(file.Write(line == std::string::npos ? text : text.substr(line + 1)));
  return file.Commit();
}

Result<Runner::Start> Runner::BeginDataset(const std::string& name) {
  const std::string stem = fmt::format("{}/datasets/{}", options_.folder, FileNameOf(name));
  B4MRL_ASSIGN_OR_RETURN(UniqueFd claim, Claim(stem + ".claim"));
  if (!claim.valid()) return Start::kLater;
  std::vector<std::string> words = {"dataset", "make",   name,
                                    "--quiet", "--data", options_.data_folder};
  if (budget_.rows) {
    words.insert(words.end(), {"--rows", fmt::format("{}", *budget_.rows)});
  }
  B4MRL_ASSIGN_OR_RETURN(Job job,
                         Job::Start("b4mrl-tools", words, stem + ".log", std::move(claim)));
  Say(fmt::format("make {}", name));
  active_.push_back({std::move(job), std::nullopt, name, std::nullopt});
  return Start::kLater;  // of the run, which waits for the dataset
}

Result<std::optional<UsedDataset>> Runner::DescribeDataset(const std::string& name) {
  B4MRL_ASSIGN_OR_RETURN(const auto listed, client_.ListDatasets());
  std::optional<UsedDataset> newest;
  int newest_version = -2;
  for (const pb::DatasetInfo& info : listed) {
    const std::optional<int> version = VersionOf(info.name(), name);
    if (!version || *version < newest_version) continue;
    newest_version = *version;
    newest = UsedDataset{info.name(), info.rows(), info.sha256(), info.columns_sha256()};
  }
  return newest;
}

Result<bool> Runner::HasDataset(const std::string& name) {
  B4MRL_ASSIGN_OR_RETURN(const auto dataset, DescribeDataset(name));
  return dataset.has_value();
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
  if (!run.dataset.empty()) add("dataset", run.dataset);
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
  for (auto active = active_.begin(); active != active_.end();) {
    const std::optional<int> exit_code = active->job.Poll();
    if (!exit_code) {
      ++active;
      continue;
    }
    B4MRL_RETURN_IF_ERROR(Finish(*active, *exit_code));
    active = active_.erase(active);
  }
  return Status();
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
    B4MRL_RETURN_IF_ERROR(FinishScoring(task, *active.scoring));
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
    B4MRL_ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::Create(task.folder + "/failed.json"));
    B4MRL_RETURN_IF_ERROR(file.Write(failed.dump() + "\n"));
    B4MRL_RETURN_IF_ERROR(file.Commit());
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
    B4MRL_ASSIGN_OR_RETURN(dataset, DescribeDataset(task.run->dataset));
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
