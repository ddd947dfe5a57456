#include "algorithms/run/run_log.h"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <system_error>
#include <utility>

#include "algorithms/policy/agent_policy.h"
#include "client/client.h"

namespace b4mrl {
namespace {

constexpr size_t kEvaluationsKept = 10;  // result.json also reports the mean of these evaluations

}  // namespace

Agent AgentOfRun(const TrainOptions& options, const LearnerContext& context, const Learner& learner,
                 uint64_t updates) {
  Agent agent = MakeAgent(learner.Policy(), options.history_length, context.ActionScale());
  agent.provenance.environment = context.environment.name;
  agent.provenance.algorithm = options.algorithm;
  agent.provenance.seed = options.seed;
  agent.provenance.updates = updates;
  agent.provenance.command = options.command;
  agent.provenance.simulator = options.simulator;
  agent.provenance.world = options.world;
  DatasetIdentity dataset = learner.dataset_identity();
  agent.provenance.dataset = std::move(dataset.full_name);
  agent.provenance.dataset_sha256 = std::move(dataset.sha256);
  agent.provenance.corruption = options.corruption;
  return agent;
}

Result<RunLog> RunLog::Open(const TrainOptions& options, Client& client, Progress& progress) {
  B4MRL_ASSIGN_OR_RETURN(const auto world, ParseNamedArguments(options.world));
  B4MRL_ASSIGN_OR_RETURN(Evaluator evaluator, Evaluator::Open(client, options.environment, world,
                                                              options.eval_episodes));
  return RunLog(options, progress, std::move(evaluator));
}

Status RunLog::Begin() {
  B4MRL_ASSIGN_OR_RETURN(log_, MetricsLog::Open(options_->folder, {}));
  return Status();
}

Result<EvaluationResult> RunLog::Evaluate(const Agent& agent, uint64_t ledger) {
  B4MRL_ASSIGN_OR_RETURN(const AgentPolicy policy, AgentPolicy::Create(agent));
  evaluator_.set_ledger(ledger);
  B4MRL_ASSIGN_OR_RETURN(EvaluationResult result, evaluator_.Run(policy));
  // Not before: a run that ends within the evaluation keeps the agent of its last returns.
  B4MRL_RETURN_IF_ERROR(WriteAgent(AgentPath(), agent));
  return result;
}

Status RunLog::Write(MetricRow row, EvaluationResult result, const RunUse& use) {
  for (const RunUseEntry& entry : kRunUseEntries) {
    row.push_back({std::string(entry.name), static_cast<double>(use.*entry.value)});
  }
  row.push_back({"evaluation_return", result.mean_return});
  row.push_back({"evaluation_return_std", result.std_return});
  row.push_back({"evaluation_score", result.score.value_or(std::nan(""))});
  B4MRL_RETURN_IF_ERROR(log_->Write(row));
  Show(row.front().value, result);
  last_updates_ = static_cast<uint64_t>(row.front().value);
  has_evaluated_ = true;
  evaluations_.push_back(std::move(result));
  if (evaluations_.size() > kEvaluationsKept) evaluations_.erase(evaluations_.begin());
  return Status();
}

void RunLog::Summarise(const EnvironmentSpec& environment, TrainSummary* summary) const {
  if (!evaluations_.empty()) {
    summary->last = evaluations_.back();
    summary->last_updates = last_updates_;
    double sum = 0;
    for (const EvaluationResult& result : evaluations_) sum += result.mean_return;
    summary->mean_return_of_last_ten = sum / static_cast<double>(evaluations_.size());
    summary->mean_score_of_last_ten = environment.NormalisedScore(summary->mean_return_of_last_ten);
  }
  if (!has_evaluated_) TakeEarlierScores(options_->folder, summary);
  if (HasAgentOf(*summary)) summary->agent_path = AgentPath();
}

bool RunLog::HasAgentOf(const TrainSummary& summary) const {
  const Result<Agent> agent = ReadAgent(AgentPath());
  if (!agent.ok() || !summary.last) return false;
  // 0 also stands for an update that a checkpoint of an earlier version does not tell.
  return summary.last_updates == 0 || agent->provenance.updates <= summary.last_updates;
}

void RunLog::RemoveLaterAgent(const TrainSummary& summary) const {
  if (!summary.agent_path.empty() || !ReadAgent(AgentPath()).ok()) return;
  std::error_code ignored;  // if it stays, the summary does not name it either
  std::filesystem::remove(AgentPath(), ignored);
}

void RunLog::Show(double update, const EvaluationResult& result) {
  std::string note = fmt::format("return {:.1f}", result.mean_return);
  std::string message = fmt::format("update {}: {} +- {:.1f}", update, note, result.std_return);
  if (result.score) {
    note = fmt::format("score {:.1f}", *result.score);
    message += ", " + note;
  }
  progress_->Message(message);
  if (result.given_up > 0) {
    progress_->Message(fmt::format("{} of {} episodes were given up by the simulator",
                                   result.given_up, result.returns.size()));
  }
  progress_->Note(note);
}

Status RunLog::Save(CheckpointWriter& writer) {
  B4MRL_RETURN_IF_ERROR(log_->Sync());
  writer.Unsigned("run/json_bytes", log_->offsets().json_bytes);
  writer.Unsigned("run/event_bytes", log_->offsets().event_bytes);
  writer.Unsigned("run/evaluations", evaluations_.size());
  writer.Unsigned("run/last_evaluation", last_updates_);
  for (size_t i = 0; i < evaluations_.size(); ++i) {
    SaveEvaluation(writer, fmt::format("run/evaluation{}", i), evaluations_[i]);
  }
  return Status();
}

Status RunLog::Load(CheckpointReader& reader) {
  // Earlier versions evaluated beside the training and saved the rows that awaited a result.
  if (reader.Has("run/held") && reader.Unsigned("run/held") > 0) {
    return Status(StatusCode::kDataLoss,
                  "the checkpoint was written amid an evaluation by an earlier version of b4mrl, "
                  "which alone can resume it");
  }
  const MetricsLog::Offsets offsets = {reader.Unsigned("run/json_bytes"),
                                       reader.Unsigned("run/event_bytes")};
  evaluations_.clear();
  // Earlier versions did not save it.
  last_updates_ = reader.Has("run/last_evaluation") ? reader.Unsigned("run/last_evaluation") : 0;
  const uint64_t kept = reader.Unsigned("run/evaluations");
  for (uint64_t i = 0; i < kept && i < kEvaluationsKept; ++i) {
    evaluations_.push_back(LoadEvaluation(reader, fmt::format("run/evaluation{}", i)));
  }
  B4MRL_RETURN_IF_ERROR(reader.status());
  B4MRL_ASSIGN_OR_RETURN(log_, MetricsLog::Open(options_->folder, offsets));
  return Status();
}

}  // namespace b4mrl
