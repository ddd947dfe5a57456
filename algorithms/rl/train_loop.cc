#include "algorithms/rl/train_loop.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
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
#include "algorithms/rl/run_log.h"
#include "client/client.h"
#include "data/agent_file.h"
#include "data/atomic_file.h"

namespace b4mrl {
namespace {

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
  TrainRun(const TrainOptions& options, Client& client, Progress& progress,
           const std::atomic<bool>& stop)
      : options_(options), client_(client), progress_(progress), stop_(stop) {}

  Status Open();
  Status Run();
  TrainSummary Summary() const;

 private:
  Status OpenFolder();
  std::vector<RunSession> EarlierSessions() const;
  Status CreateLearner();
  Status RestoreNewest();
  Status Restore(uint64_t update);
  Status Update();
  Status CheckFinite() const;
  Status Diverged(uint64_t update, std::string_view what) const;
  Status AfterUpdate(bool last);
  MetricRow TakeRow();
  Status Checkpoint();
  bool ReachedScore() const;
  Agent PresentAgent() const;

  const TrainOptions& options_;
  Client& client_;
  Progress& progress_;
  const std::atomic<bool>& stop_;
  UniqueFd lock_;
  LearnerContext context_;
  std::unique_ptr<Learner> learner_;
  std::optional<RunLog> log_;
  MetricMeans means_;
  uint64_t update_ = 0;
  uint64_t checkpoint_update_ = UINT64_MAX;  // of the newest checkpoint
  double seconds_before_ = 0;                // spent before the last resume
  Clock::time_point start_ = Clock::now();   // of this process's Run, preparation included
  Clock::time_point last_log_ = Clock::now();
  uint64_t last_log_update_ = 0;
};

Status TrainRun::Open() {
  UseOneBlasThread();
  B4MRL_RETURN_IF_ERROR(OpenFolder());
  B4MRL_RETURN_IF_ERROR(CreateLearner());
  B4MRL_ASSIGN_OR_RETURN(RunLog log, RunLog::Open(options_, client_, progress_));
  log_.emplace(std::move(log));

  const bool resumes = options_.resume && !ListCheckpoints(options_.folder).empty();
  std::vector<RunSession> earlier;
  if (resumes) earlier = EarlierSessions();
  B4MRL_RETURN_IF_ERROR(WriteRunRecord(options_, earlier));
  B4MRL_RETURN_IF_ERROR(WriteRunConfiguration(options_));
  return resumes ? RestoreNewest() : log_->Begin();
}

// Those of a resumed run. A record that cannot be read has been reported by whoever needs it.
std::vector<RunSession> TrainRun::EarlierSessions() const {
  const Result<RunRecord> record = ReadRunRecord(options_.folder);
  if (!record.ok() || record->sessions.empty()) return {};
  const RunSession &last = record->sessions.back(), present = PresentSession();
  if (last != present) {
    progress_.Message(
        fmt::format("the run was last computed by version {} on BLAS kernel {}, now by {} on {}: "
                    "from here on its numbers may differ from an uninterrupted run's",
                    last.version, last.blas_kernel, present.version, present.blas_kernel));
  }
  return record->sessions;
}

Status TrainRun::OpenFolder() {
  std::error_code error;
  std::filesystem::create_directories(options_.folder, error);
  if (error) return IoError("create", options_.folder, error.value());
  B4MRL_ASSIGN_OR_RETURN(lock_, LockFolder(options_.folder));
  return CheckNoEarlierRun(options_);
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
  context_.threads = options_.threads;
  context_.stop = &stop_;
  context_.hyperparameters = options_.hyperparameters;
  B4MRL_RETURN_IF_ERROR(CheckTraining(options_, context_.environment));
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
  means_.Load(reader);
  B4MRL_RETURN_IF_ERROR(reader.status());
  B4MRL_RETURN_IF_ERROR(learner_->Load(reader));
  B4MRL_RETURN_IF_ERROR(reader.status());
  B4MRL_RETURN_IF_ERROR(log_->Load(reader));
  last_log_update_ = checkpoint_update_ = update_;
  return Status();
}

Status TrainRun::Run() {
  start_ = Clock::now();
  const bool fresh = checkpoint_update_ == UINT64_MAX;
  if (fresh) {
    B4MRL_RETURN_IF_ERROR(learner_->Prepare(progress_));
    if (stop_) return Status();  // perhaps half prepared
    B4MRL_RETURN_IF_ERROR(Checkpoint());
  }
  if (options_.stop_at_score) B4MRL_RETURN_IF_ERROR(log_->Wait());
  last_log_ = Clock::now();
  progress_.Start("train", "updates", options_.updates, update_);
  while (update_ < options_.updates && !ReachedScore() && !stop_) {
    B4MRL_RETURN_IF_ERROR(Update());
    progress_.Update(update_);
    B4MRL_RETURN_IF_ERROR(AfterUpdate(update_ == options_.updates));
    B4MRL_RETURN_IF_ERROR(log_->Poll());
  }
  if (update_ >= options_.updates) B4MRL_RETURN_IF_ERROR(log_->Wait());
  if (checkpoint_update_ != update_) B4MRL_RETURN_IF_ERROR(Checkpoint());
  progress_.Finish();
  return Status();
}

// An error may come from a policy whose actions are no numbers any more: then that is the reason.
Status TrainRun::Update() {
  const Status status = learner_->Update(means_);
  B4MRL_RETURN_IF_ERROR(CheckFinite());
  if (status.ok()) {
    ++update_;
    return status;
  }
  const Status policy = PresentAgent().Validate();
  return policy.ok() ? status : Diverged(update_, policy.message());
}

Status TrainRun::CheckFinite() const {
  const auto& metric = means_.first_nonfinite();
  if (!metric) return Status();
  return Diverged(update_ + 1, fmt::format("{} became {}", metric->name, metric->value));
}

// A learner that diverged never recovers; its last good checkpoint may still be of use.
Status TrainRun::Diverged(uint64_t update, std::string_view what) const {
  return Status(StatusCode::kFailedPrecondition,
                fmt::format("the run diverged: {} at update {}; the last good state is {}", what,
                            update, CheckpointPath(options_.folder, checkpoint_update_)));
}

Status TrainRun::AfterUpdate(bool last) {
  if (last || update_ % options_.eval_every == 0) {
    const Agent agent = PresentAgent();
    if (Status policy = agent.Validate(); !policy.ok()) return Diverged(update_, policy.message());
    B4MRL_RETURN_IF_ERROR(log_->Evaluate(agent, TakeRow()));
    if (last || options_.stop_at_score) B4MRL_RETURN_IF_ERROR(log_->Wait());
  } else if (update_ % options_.log_every == 0) {
    B4MRL_RETURN_IF_ERROR(log_->Write(TakeRow()));
  }
  if (last || ReachedScore() || update_ % options_.checkpoint_every == 0) return Checkpoint();
  return Status();
}

MetricRow TrainRun::TakeRow() {
  const double interval = SecondsSince(last_log_);
  MetricRow row = {
      {"update", static_cast<double>(update_)},
      {"environment_steps", static_cast<double>(learner_->environment_steps())},
      {"seconds", seconds_before_ + SecondsSince(start_)},
      {"updates_per_second", static_cast<double>(update_ - last_log_update_) / interval},
  };
  const MetricRow means = means_.Take();
  row.insert(row.end(), means.begin(), means.end());
  last_log_ = Clock::now();
  last_log_update_ = update_;
  return row;
}

Status TrainRun::Checkpoint() {
  B4MRL_ASSIGN_OR_RETURN(CheckpointWriter writer,
                         CheckpointWriter::Create(CheckpointPath(options_.folder, update_)));
  writer.Unsigned("run/update", update_);
  writer.Number("run/seconds", seconds_before_ + SecondsSince(start_));
  B4MRL_RETURN_IF_ERROR(log_->Save(writer));
  means_.Save(writer);
  B4MRL_RETURN_IF_ERROR(learner_->Save(writer));
  if (writer.first_nonfinite()) {
    return Diverged(update_, fmt::format("{} was not finite", *writer.first_nonfinite()));
  }
  B4MRL_RETURN_IF_ERROR(writer.Commit());
  checkpoint_update_ = update_;
  RemoveOldCheckpoints(options_.folder);
  return Status();
}

bool TrainRun::ReachedScore() const {
  if (!options_.stop_at_score || log_->evaluations().empty()) return false;
  const std::optional<double>& score = log_->evaluations().back().score;
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
  summary.agent_path = log_->AgentPath();
  const std::vector<EvaluationResult>& evaluations = log_->evaluations();
  if (evaluations.empty()) return summary;
  summary.last = evaluations.back();
  double sum = 0;
  for (const EvaluationResult& result : evaluations) sum += result.mean_return;
  summary.mean_return_of_last_ten = sum / static_cast<double>(evaluations.size());
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
    if (summary.last->given_up > 0) json["given_up_episodes"] = summary.last->given_up;
    if (summary.last->score) json["score"] = *summary.last->score;
    json["mean_return_of_last_ten"] = summary.mean_return_of_last_ten;
    if (summary.mean_score_of_last_ten) {
      json["mean_score_of_last_ten"] = *summary.mean_score_of_last_ten;
    }
  }
  return json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

Status CheckTraining(const TrainOptions& options, const EnvironmentSpec& environment) {
  LearnerContext context;
  context.environment = environment;
  context.history_length = options.history_length;
  context.seed = options.seed;
  context.hyperparameters = options.hyperparameters;
  const uint64_t values = environment.observation.size();
  const uint64_t most = std::min<uint64_t>(kMaxAgentHistory, kMaxAgentLayerWidth / values);
  if (options.history_length < 1 || options.history_length > most) {
    return InvalidNumber("--history", options.history_length,
                         fmt::format("1..{} with the {} values of an observation of {}", most,
                                     values, environment.name));
  }
  B4MRL_ASSIGN_OR_RETURN(const Algorithm* algorithm, FindAlgorithm(options.algorithm));
  return algorithm->check == nullptr ? Status() : algorithm->check(context);
}

Result<TrainSummary> Train(const TrainOptions& options, Client& client, Progress& progress,
                           const std::atomic<bool>& stop) {
  TrainRun run(options, client, progress, stop);
  B4MRL_RETURN_IF_ERROR(run.Open());
  B4MRL_RETURN_IF_ERROR(run.Run());
  const TrainSummary summary = run.Summary();
  B4MRL_RETURN_IF_ERROR(
      WriteSmallFile(options.folder + "/result.json", SummaryJson(options, summary) + "\n"));
  return summary;
}

}  // namespace b4mrl
