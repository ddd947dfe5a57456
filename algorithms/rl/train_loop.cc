#include "algorithms/rl/train_loop.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <system_error>
#include <utility>
#include <vector>

#include "algorithms/list.h"
#include "algorithms/nn/blas.h"
#include "algorithms/nn/checkpoint.h"
#include "algorithms/rl/agent_policy.h"
#include "algorithms/rl/metrics.h"
#include "client/client.h"
#include "data/agent_file.h"
#include "data/atomic_file.h"

namespace b4mrl {
namespace {

constexpr size_t kEvaluationsKept = 10;  // a run's score is also reported as their mean
constexpr double kNotMeasured = std::numeric_limits<double>::quiet_NaN();

// A second trainer in the same folder would interleave its files with ours.
Result<UniqueFd> LockFolder(const std::string& folder) {
  const std::string path = folder + "/lock";
  UniqueFd fd(open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644));
  if (!fd.valid()) return IoError("create", path, errno);
  if (flock(fd.get(), LOCK_EX | LOCK_NB) != 0) {
    return Status(StatusCode::kBusy, fmt::format("another process trains in {}", folder));
  }
  return fd;
}

class TrainRun {
 public:
  TrainRun(const TrainOptions& options, Client& client, Progress& progress)
      : options_(options), client_(client), progress_(progress) {}

  Status Open();
  Status Run(const std::atomic<bool>& stop);
  TrainSummary Summary() const;

 private:
  Status OpenFolder();
  Status CreateLearner();
  Status RestoreNewest();
  Status Restore(uint64_t update);
  Status CheckFinite() const;
  Status AfterUpdate(bool last);
  Status Evaluate();
  Status Log(const EvaluationResult* evaluation);
  Status Checkpoint();
  bool ReachedScore() const;
  Agent PresentAgent() const;
  std::string AgentPath() const { return options_.folder + "/agent.h5"; }

  const TrainOptions& options_;
  Client& client_;
  Progress& progress_;
  UniqueFd lock_;
  LearnerContext context_;
  std::unique_ptr<Learner> learner_;
  std::optional<Evaluator> evaluator_;
  std::optional<MetricsLog> log_;
  MetricMeans means_;
  uint64_t update_ = 0;
  uint64_t checkpoint_update_ = UINT64_MAX;  // of the newest checkpoint
  double seconds_before_ = 0;                // spent before the last resume
  Clock::time_point start_ = Clock::now();
  Clock::time_point last_log_ = Clock::now();
  uint64_t last_log_update_ = 0;
  std::vector<EvaluationResult> evaluations_;  // the newest kEvaluationsKept
};

Status TrainRun::Open() {
  UseOneBlasThread();
  B4MRL_RETURN_IF_ERROR(OpenFolder());
  B4MRL_RETURN_IF_ERROR(CreateLearner());
  B4MRL_ASSIGN_OR_RETURN(Evaluator evaluator, Evaluator::Open(client_, options_.environment, {},
                                                              options_.eval_episodes));
  evaluator_.emplace(std::move(evaluator));

  const bool resumes = options_.resume && !ListCheckpoints(options_.folder).empty();
  B4MRL_RETURN_IF_ERROR(WriteRunRecord(options_));
  if (resumes) return RestoreNewest();
  B4MRL_ASSIGN_OR_RETURN(MetricsLog log, MetricsLog::Open(options_.folder, {}));
  log_.emplace(std::move(log));
  return Status();
}

Status TrainRun::OpenFolder() {
  std::error_code error;
  std::filesystem::create_directories(options_.folder, error);
  if (error) return IoError("create", options_.folder, error.value());
  B4MRL_ASSIGN_OR_RETURN(lock_, LockFolder(options_.folder));
  if (!options_.resume && !ListCheckpoints(options_.folder).empty()) {
    return Status(
        StatusCode::kFailedPrecondition,
        fmt::format("{} holds an earlier run; continue it with --resume, or choose another "
                    "--out",
                    options_.folder));
  }
  return Status();
}

Status TrainRun::CreateLearner() {
  B4MRL_ASSIGN_OR_RETURN(const Algorithm* algorithm, FindAlgorithm(options_.algorithm));
  B4MRL_ASSIGN_OR_RETURN(context_.environment, client_.FindEnvironment(options_.environment));
  B4MRL_ASSIGN_OR_RETURN(context_.simulator, ParseNamedArguments(options_.simulator));
  B4MRL_ASSIGN_OR_RETURN(context_.corruption, ParseNamedArguments(options_.corruption));
  context_.client = &client_;
  context_.dataset = options_.dataset;
  context_.history_length = options_.history_length;
  context_.seed = options_.seed;
  context_.updates = options_.updates;
  context_.folder = options_.folder;
  context_.hyperparameters = options_.hyperparameters;
  B4MRL_ASSIGN_OR_RETURN(learner_, algorithm->create(context_));
  return Status();
}

// The newest checkpoint, or the one before it when that cannot be read.
Status TrainRun::RestoreNewest() {
  Status status;
  for (const uint64_t update : ListCheckpoints(options_.folder)) {
    status = Restore(update);
    if (status.ok()) {
      progress_.Message(fmt::format("resumed at update {}", update));
      return status;
    }
    progress_.Message(fmt::format("cannot resume at update {}: {}", update, status.ToString()));
    B4MRL_RETURN_IF_ERROR(CreateLearner());  // half a state is none
  }
  return status;
}

Status TrainRun::Restore(uint64_t update) {
  B4MRL_ASSIGN_OR_RETURN(CheckpointReader reader,
                         CheckpointReader::Open(CheckpointPath(options_.folder, update)));
  update_ = reader.Unsigned("run/update");
  seconds_before_ = reader.Number("run/seconds");
  const MetricsLog::Offsets offsets = {reader.Unsigned("run/csv_bytes"),
                                       reader.Unsigned("run/json_bytes")};
  const uint64_t kept = reader.Unsigned("run/evaluations");
  evaluations_.clear();
  for (uint64_t i = 0; i < kept && i < kEvaluationsKept; ++i) {
    evaluations_.push_back(LoadEvaluation(reader, fmt::format("run/evaluation{}", i)));
  }
  means_.Load(reader);
  B4MRL_RETURN_IF_ERROR(reader.status());
  B4MRL_RETURN_IF_ERROR(learner_->Load(reader));
  B4MRL_RETURN_IF_ERROR(reader.status());
  B4MRL_ASSIGN_OR_RETURN(MetricsLog log, MetricsLog::Open(options_.folder, offsets));
  log_.emplace(std::move(log));
  last_log_update_ = checkpoint_update_ = update_;
  return Status();
}

Status TrainRun::Run(const std::atomic<bool>& stop) {
  const bool fresh = checkpoint_update_ == UINT64_MAX;
  if (fresh) {
    B4MRL_RETURN_IF_ERROR(learner_->Prepare(progress_));
    B4MRL_RETURN_IF_ERROR(Checkpoint());
  }
  start_ = last_log_ = Clock::now();
  progress_.Start("train", "updates", options_.updates, update_);
  while (update_ < options_.updates && !ReachedScore() && !stop) {
    B4MRL_RETURN_IF_ERROR(learner_->Update(means_));
    B4MRL_RETURN_IF_ERROR(CheckFinite());
    ++update_;
    progress_.Update(update_);
    B4MRL_RETURN_IF_ERROR(AfterUpdate(update_ == options_.updates));
  }
  if (checkpoint_update_ != update_) B4MRL_RETURN_IF_ERROR(Checkpoint());
  progress_.Finish();
  return Status();
}

// A learner that diverged never recovers; its last good checkpoint may still be of use.
Status TrainRun::CheckFinite() const {
  const auto& metric = means_.first_nonfinite();
  if (!metric) return Status();
  return Status(
      StatusCode::kFailedPrecondition,
      fmt::format("{} became {} at update {}; the last good state is {}", metric->name,
                  metric->value, update_ + 1, CheckpointPath(options_.folder, checkpoint_update_)));
}

Status TrainRun::AfterUpdate(bool last) {
  if (last || update_ % options_.eval_every == 0) {
    B4MRL_RETURN_IF_ERROR(Evaluate());
    B4MRL_RETURN_IF_ERROR(Log(&evaluations_.back()));
  } else if (update_ % options_.log_every == 0) {
    B4MRL_RETURN_IF_ERROR(Log(nullptr));
  }
  if (last || ReachedScore() || update_ % options_.checkpoint_every == 0) return Checkpoint();
  return Status();
}

Status TrainRun::Evaluate() {
  const Agent agent = PresentAgent();
  B4MRL_RETURN_IF_ERROR(WriteAgent(AgentPath(), agent));
  B4MRL_ASSIGN_OR_RETURN(const AgentPolicy policy, AgentPolicy::Create(agent));
  B4MRL_ASSIGN_OR_RETURN(EvaluationResult result, evaluator_->Run(policy));
  const std::string score = result.score ? fmt::format("score {:.1f}", *result.score)
                                         : fmt::format("return {:.1f}", result.mean_return);
  progress_.Message(fmt::format("update {}: return {:.1f} +- {:.1f}, {}", update_,
                                result.mean_return, result.std_return, score));
  progress_.Update(update_, score);
  evaluations_.push_back(std::move(result));
  if (evaluations_.size() > kEvaluationsKept) evaluations_.erase(evaluations_.begin());
  return Status();
}

Status TrainRun::Log(const EvaluationResult* evaluation) {
  const double interval = SecondsSince(last_log_);
  MetricRow row = {
      {"update", static_cast<double>(update_)},
      {"environment_steps", static_cast<double>(learner_->environment_steps())},
      {"seconds", seconds_before_ + SecondsSince(start_)},
      {"updates_per_second", static_cast<double>(update_ - last_log_update_) / interval},
  };
  const MetricRow means = means_.Take();
  row.insert(row.end(), means.begin(), means.end());
  const bool has_score = evaluation != nullptr && evaluation->score.has_value();
  row.push_back({"evaluation_return", evaluation ? evaluation->mean_return : kNotMeasured});
  row.push_back({"evaluation_return_std", evaluation ? evaluation->std_return : kNotMeasured});
  row.push_back({"evaluation_score", has_score ? *evaluation->score : kNotMeasured});
  last_log_ = Clock::now();
  last_log_update_ = update_;
  return log_->Write(row);
}

Status TrainRun::Checkpoint() {
  B4MRL_RETURN_IF_ERROR(log_->Sync());
  B4MRL_ASSIGN_OR_RETURN(CheckpointWriter writer,
                         CheckpointWriter::Create(CheckpointPath(options_.folder, update_)));
  writer.Unsigned("run/update", update_);
  writer.Number("run/seconds", seconds_before_ + SecondsSince(start_));
  writer.Unsigned("run/csv_bytes", log_->offsets().csv_bytes);
  writer.Unsigned("run/json_bytes", log_->offsets().json_bytes);
  writer.Unsigned("run/evaluations", evaluations_.size());
  for (size_t i = 0; i < evaluations_.size(); ++i) {
    SaveEvaluation(writer, fmt::format("run/evaluation{}", i), evaluations_[i]);
  }
  means_.Save(writer);
  B4MRL_RETURN_IF_ERROR(learner_->Save(writer));
  B4MRL_RETURN_IF_ERROR(writer.Commit());
  checkpoint_update_ = update_;
  RemoveOldCheckpoints(options_.folder);
  return Status();
}

bool TrainRun::ReachedScore() const {
  if (!options_.stop_at_score || evaluations_.empty()) return false;
  const std::optional<double>& score = evaluations_.back().score;
  return score && *score >= *options_.stop_at_score;
}

Agent TrainRun::PresentAgent() const {
  Agent agent = MakeAgent(learner_->Policy(), options_.history_length, context_.ActionScale());
  agent.provenance.environment = context_.environment.name;
  agent.provenance.algorithm = options_.algorithm;
  agent.provenance.seed = options_.seed;
  agent.provenance.updates = update_;
  agent.provenance.command = options_.command;
  agent.provenance.simulator = options_.simulator;
  agent.provenance.dataset = options_.dataset;
  agent.provenance.dataset_sha256 = learner_->dataset_sha256();
  agent.provenance.corruption = options_.corruption;
  return agent;
}

TrainSummary TrainRun::Summary() const {
  TrainSummary summary;
  summary.updates = update_;
  summary.environment_steps = learner_->environment_steps();
  summary.interrupted = update_ < options_.updates && !ReachedScore();
  summary.agent_path = AgentPath();
  if (evaluations_.empty()) return summary;
  summary.last = evaluations_.back();
  double sum = 0;
  for (const EvaluationResult& result : evaluations_) sum += result.mean_return;
  summary.mean_return_of_last_ten = sum / static_cast<double>(evaluations_.size());
  summary.mean_score_of_last_ten =
      context_.environment.NormalisedScore(summary.mean_return_of_last_ten);
  return summary;
}

}  // namespace

std::string SummaryJson(const TrainOptions& options, const TrainSummary& summary) {
  nlohmann::ordered_json json;
  json["algorithm"] = options.algorithm;
  json["environment"] = options.environment;
  json["simulator"] = options.simulator;
  json["dataset"] = options.dataset;
  json["corruption"] = options.corruption;
  json["seed"] = options.seed;
  json["updates"] = summary.updates;
  json["environment_steps"] = summary.environment_steps;
  json["interrupted"] = summary.interrupted;
  json["agent"] = summary.agent_path;
  if (summary.last) {
    json["returns"] = summary.last->returns;
    json["mean_return"] = summary.last->mean_return;
    json["std_return"] = summary.last->std_return;
    if (summary.last->score) json["score"] = *summary.last->score;
    json["mean_return_of_last_ten"] = summary.mean_return_of_last_ten;
    if (summary.mean_score_of_last_ten) {
      json["mean_score_of_last_ten"] = *summary.mean_score_of_last_ten;
    }
  }
  return json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

Result<TrainSummary> Train(const TrainOptions& options, Client& client, Progress& progress,
                           const std::atomic<bool>& stop) {
  TrainRun run(options, client, progress);
  B4MRL_RETURN_IF_ERROR(run.Open());
  B4MRL_RETURN_IF_ERROR(run.Run(stop));
  const TrainSummary summary = run.Summary();
  B4MRL_ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::Create(options.folder + "/result.json"));
  B4MRL_RETURN_IF_ERROR(file.Write(SummaryJson(options, summary) + "\n"));
  B4MRL_RETURN_IF_ERROR(file.Commit());
  return summary;
}

}  // namespace b4mrl
