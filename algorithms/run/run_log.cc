#include "algorithms/run/run_log.h"

#include <fmt/format.h>

#include <cmath>
#include <span>
#include <utility>

#include "client/client.h"
#include "data/files/atomic_file.h"
#include "proto/base/child_program.h"

namespace b4mrl {
namespace {

constexpr size_t kEvaluationsKept = 10;  // a run's score is also reported as their mean
constexpr size_t kRowsHeld = 10'000;     // one more waits for the evaluation
constexpr size_t kMaxAgentBytes = 64 << 20;

void SaveRow(CheckpointWriter& writer, const std::string& name, const MetricRow& row) {
  writer.Unsigned(name + "/metrics", row.size());
  for (size_t i = 0; i < row.size(); ++i) {
    writer.Text(fmt::format("{}/{}/name", name, i), row[i].name);
    writer.Number(fmt::format("{}/{}/value", name, i), row[i].value);
  }
}

MetricRow LoadRow(CheckpointReader& reader, const std::string& name) {
  MetricRow row;
  const uint64_t metrics = reader.Unsigned(name + "/metrics");
  for (uint64_t i = 0; i < metrics && reader.status().ok(); ++i) {
    std::string metric = reader.Text(fmt::format("{}/{}/name", name, i));
    row.push_back({std::move(metric), reader.Number(fmt::format("{}/{}/value", name, i))});
  }
  return row;
}

// An agent file's bytes as a checkpoint stores them.
Result<std::vector<uint8_t>> ReadBytes(const std::string& path) {
  B4MRL_ASSIGN_OR_RETURN(const std::string text, ReadSmallFile(path, kMaxAgentBytes));
  return std::vector<uint8_t>(text.begin(), text.end());
}

}  // namespace

Result<RunLog> RunLog::Open(const TrainOptions& options, Client& client, Progress& progress) {
  B4MRL_ASSIGN_OR_RETURN(Evaluator evaluator,
                         Evaluator::Open(client, options.environment, {}, options.eval_episodes));
  return RunLog(options, client, progress, std::move(evaluator));
}

Status RunLog::Begin() {
  B4MRL_ASSIGN_OR_RETURN(log_, MetricsLog::Open(options_->folder, {}));
  return Status();
}

Status RunLog::Write(MetricRow row) {
  if (held_.empty()) return log_->Write(row);
  held_.push_back(std::move(row));
  return held_.size() > kRowsHeld ? Wait() : Status();
}

Status RunLog::Evaluate(const Agent& agent, MetricRow row) {
  B4MRL_RETURN_IF_ERROR(Wait());
  B4MRL_RETURN_IF_ERROR(WriteAgent(AgentPath(), agent));
  held_.push_back(std::move(row));
  return StartEvaluation();
}

Status RunLog::StartEvaluation() {
  if (!options_->eval_inline) {
    const std::string program =
        options_->evaluator.empty() ? ProgramBesideThisOne("b4mrl-tools") : options_->evaluator;
    auto started = EvaluationProcess::Start({program, client_->endpoint(), AgentPath(),
                                             options_->environment, options_->eval_episodes});
    if (started.ok()) {
      process_.emplace(*std::move(started));
      return Status();
    }
    progress_->Message(fmt::format("{}; evaluating in this process", started.status().message()));
  }
  B4MRL_ASSIGN_OR_RETURN(EvaluationResult result, EvaluateHere());
  return Take(std::move(result));
}

Result<EvaluationResult> RunLog::EvaluateHere() {
  B4MRL_ASSIGN_OR_RETURN(const Agent agent, ReadAgent(AgentPath()));
  B4MRL_ASSIGN_OR_RETURN(const AgentPolicy policy, AgentPolicy::Create(agent));
  return evaluator_.Run(policy);
}

Status RunLog::Poll() { return process_ && process_->Ended() ? Wait() : Status(); }

Status RunLog::Wait() {
  if (!process_) return Status();
  auto result = process_->Wait();
  process_.reset();
  if (!result.ok()) {
    progress_->Message(
        fmt::format("{}; evaluating again in this process", result.status().message()));
    result = EvaluateHere();
  }
  B4MRL_RETURN_IF_ERROR(result.status());
  return Take(*std::move(result));
}

Status RunLog::Take(EvaluationResult result) {
  MetricRow& row = held_.front();
  row.push_back({"evaluation_return", result.mean_return});
  row.push_back({"evaluation_return_std", result.std_return});
  row.push_back({"evaluation_score", result.score.value_or(std::nan(""))});
  const std::string score = result.score ? fmt::format("score {:.1f}", *result.score)
                                         : fmt::format("return {:.1f}", result.mean_return);
  progress_->Message(fmt::format("update {}: return {:.1f} +- {:.1f}, {}", row.front().value,
                                 result.mean_return, result.std_return, score));
  if (result.given_up > 0) {
    progress_->Message(fmt::format("{} of {} episodes were given up by the simulator",
                                   result.given_up, result.returns.size()));
  }
  progress_->Note(score);
  evaluations_.push_back(std::move(result));
  if (evaluations_.size() > kEvaluationsKept) evaluations_.erase(evaluations_.begin());
  for (const MetricRow& held : held_) B4MRL_RETURN_IF_ERROR(log_->Write(held));
  held_.clear();
  return Status();
}

Status RunLog::Save(CheckpointWriter& writer) {
  B4MRL_RETURN_IF_ERROR(log_->Sync());
  writer.Unsigned("run/json_bytes", log_->offsets().json_bytes);
  writer.Unsigned("run/event_bytes", log_->offsets().event_bytes);
  writer.Unsigned("run/evaluations", evaluations_.size());
  for (size_t i = 0; i < evaluations_.size(); ++i) {
    SaveEvaluation(writer, fmt::format("run/evaluation{}", i), evaluations_[i]);
  }
  writer.Unsigned("run/held", held_.size());
  for (size_t i = 0; i < held_.size(); ++i) {
    SaveRow(writer, fmt::format("run/held{}", i), held_[i]);
  }
  if (held_.empty()) return Status();
  B4MRL_ASSIGN_OR_RETURN(const std::vector<uint8_t> agent, ReadBytes(AgentPath()));
  writer.Bytes("run/held_agent", agent);
  return Status();
}

Status RunLog::Load(CheckpointReader& reader) {
  const MetricsLog::Offsets offsets = {reader.Unsigned("run/json_bytes"),
                                       reader.Unsigned("run/event_bytes")};
  process_.reset();
  evaluations_.clear();
  held_.clear();
  const uint64_t kept = reader.Unsigned("run/evaluations");
  for (uint64_t i = 0; i < kept && i < kEvaluationsKept; ++i) {
    evaluations_.push_back(LoadEvaluation(reader, fmt::format("run/evaluation{}", i)));
  }
  const uint64_t held = reader.Unsigned("run/held");
  for (uint64_t i = 0; i < held && reader.status().ok(); ++i) {
    held_.push_back(LoadRow(reader, fmt::format("run/held{}", i)));
  }
  B4MRL_RETURN_IF_ERROR(reader.status());
  B4MRL_ASSIGN_OR_RETURN(log_, MetricsLog::Open(options_->folder, offsets));
  if (held_.empty()) return Status();
  const std::vector<uint8_t> agent = reader.Bytes("run/held_agent");
  B4MRL_RETURN_IF_ERROR(reader.status());
  B4MRL_RETURN_IF_ERROR(WriteSmallFile(AgentPath(), std::as_bytes(std::span(agent))));
  return StartEvaluation();
}

}  // namespace b4mrl
