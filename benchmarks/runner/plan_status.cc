#include "benchmarks/runner/plan_status.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <nlohmann/json.hpp>
#include <system_error>

#include "algorithms/run/run_result.h"
#include "benchmarks/jobs/job.h"
#include "benchmarks/jobs/training_order.h"
#include "benchmarks/records/learned.h"
#include "benchmarks/runner/cost.h"
#include "benchmarks/runner/frozen_plan.h"
#include "benchmarks/runner/run_folder.h"
#include "data/d4rl/agent_file.h"
#include "data/files/file_hash.h"

namespace b4mrl {
namespace {

using Json = nlohmann::ordered_json;

bool Exists(const std::string& path) {
  std::error_code error;
  return std::filesystem::exists(path, error);
}

// The names of the evaluations of the run's agent that its result lacks.
std::vector<std::string> MissingScorings(const PlannedRun& run, const RunResult& result) {
  std::vector<std::string> names;
  for (const Scoring& scoring : run.scorings) {
    if (scoring.name == kOwnScoring || result.scorings.contains(scoring.name)) continue;
    names.push_back(scoring.name);
  }
  return names;
}

RunProgress ProgressOf(const PlannedRun& run, const std::optional<RunResult>& result,
                       uint64_t target, const std::string& run_folder,
                       const std::string& failure) {
  if (result && result->IsDone(run, target)) {
    const bool can_be_scored =
        !MissingScorings(run, *result).empty() && HoldsAgentOf(*result, run_folder);
    if (!can_be_scored) return RunProgress::kDone;
  }
  if (IsClaimed(run_folder + "/claim")) return RunProgress::kRunning;
  if (IsMarkedDiverged(run_folder)) return RunProgress::kDiverged;
  const auto state = ReadRunStatus(run_folder);
  if (state.ok() && state->state == RunState::kFailed) return RunProgress::kFailed;
  if (!failure.empty()) return RunProgress::kFailed;
  return result || Exists(run_folder + "/log") ? RunProgress::kBegun : RunProgress::kWaiting;
}

// A finished result stays while its run goes on, whose folder then says how far it has come.
uint64_t UpdatesOf(const PlannedRunStatus& run, const std::string& run_folder) {
  const auto evaluated = EvaluatedUpdates(run_folder);
  if (run.progress != RunProgress::kDone && evaluated.ok()) return *evaluated;
  return run.result ? run.result->updates : 0;
}

// The numbers of runs in the folder's plan.json by id.
std::map<std::string, uint64_t> FrozenIndices(const std::string& folder,
                                              std::vector<std::string>* problems) {
  std::map<std::string, uint64_t> indices;
  const auto frozen = ReadFrozenPlan(folder);
  if (!frozen.ok()) problems->push_back(frozen.status().message());
  for (size_t i = 0; frozen.ok() && i < frozen->size(); ++i) indices[(*frozen)[i]] = i;
  return indices;
}

// Numbers as numbers, the rest as texts, as records of runs have them.
Json AsJson(const HyperparameterValues& values) {
  Json json = Json::object();
  for (const auto& [name, text] : values) {
    const Json parsed = Json::parse(text, nullptr, /*allow_exceptions=*/false);
    json[name] = parsed.is_number() ? Json(parsed.get<double>()) : Json(text);
  }
  return json;
}

}  // namespace

std::string_view RunProgressName(RunProgress progress) {
  switch (progress) {
    case RunProgress::kDone:
      return "done";
    case RunProgress::kRunning:
      return "running";
    case RunProgress::kDiverged:
      return "diverged";
    case RunProgress::kFailed:
      return "failed";
    case RunProgress::kBegun:
      return "begun";
    case RunProgress::kWaiting:
      break;
  }
  return "waiting";
}

bool HoldsAgentOf(const RunResult& result, const std::string& run_folder) {
  const auto agent = Sha256OfFile(run_folder + "/agent.h5", kMaxAgentFileBytes);
  return agent.ok() && *agent == result.agent_sha256;
}

std::vector<std::string> DoneOtherwise(const PlannedRun& run, const RunResult& result,
                                       const std::string& run_folder,
                                       const std::string& results_folder) {
  std::vector<std::string> reasons;
  if (run.is_users() && !result.learner_sha256.empty() &&
      result.learner_sha256 != LearnerHash(run)) {
    reasons.emplace_back("was trained by another --learner");
  }
  if (result.IsOfOtherRows(run)) {
    reasons.push_back(fmt::format("learned from other rows of {} than those at hand",
                                  run.full_dataset));
  }
  const auto missing = MissingScorings(run, result);
  // A learner that scores itself has left no agent.
  if (!missing.empty() && !result.agent_sha256.empty() && !HoldsAgentOf(result, run_folder)) {
    reasons.push_back(fmt::format("lacks the scorings {}, and {} no longer holds its agent",
                                  fmt::join(missing, ", "), run_folder));
  }
  for (std::string& reason : reasons) {
    reason = fmt::format("{} {}; remove {} to train it anew", run.name, reason,
                         ResultPath(results_folder, run));
  }
  return reasons;
}

size_t PlanStatus::CountOf(RunProgress progress) const {
  const auto found = counts.find(progress);
  return found == counts.end() ? 0 : found->second;
}

PlanStatus StatusOf(const std::vector<PlannedRun>& plan, const std::string& folder,
                    const std::string& results_folder, uint32_t until_settled) {
  PlanStatus status;
  const auto indices = FrozenIndices(folder, &status.problems);
  CostModel costs;
  for (const PlannedRun& run : plan) {
    const auto read = ReadResult(ResultPath(results_folder, run));
    if (!read.ok()) status.problems.push_back(read.status().message());
    const std::string run_folder = RunFolder(folder, run);
    PlannedRunStatus each = {.result = read.ok() ? *read : std::nullopt};
    const std::string failure = FailureOf(run_folder);
    each.target = UpdatesToTrain(run, each.result, until_settled);
    each.progress = ProgressOf(run, each.result, each.target, run_folder, failure);
    if (each.progress == RunProgress::kDone) {
      std::ranges::move(DoneOtherwise(run, *each.result, run_folder, results_folder),
                        std::back_inserter(status.problems));
    }
    if (each.progress == RunProgress::kFailed) each.failure = failure;
    each.updates = UpdatesOf(each, run_folder);
    if (const auto found = indices.find(run.id); found != indices.end()) each.index = found->second;
    if (Exists(run_folder + "/log")) each.log = run_folder + "/log";
    if (each.result) costs.Learn(run, *each.result);
    status.runs.push_back(std::move(each));
  }
  for (size_t i = 0; i < plan.size(); ++i) {
    const PlannedRun& run = plan[i];
    const auto& [progress, result, updates, target, index, log, failure] = status.runs[i];
    ++status.counts[progress];
    status.cells += run.benchmarks.size();
    status.seconds += result ? result->seconds : 0;
    if (progress == RunProgress::kDone) {
      status.filled += run.benchmarks.size();
      continue;
    }
    const uint64_t left = target - std::min(updates, target);
    status.seconds_left += costs.SecondsOf(run, static_cast<double>(left));
  }
  return status;
}

std::string TextOf(const std::vector<PlannedRun>& plan, const PlanStatus& status) {
  std::string text;
  for (size_t i = 0; i < plan.size(); ++i) {
    const PlannedRun& run = plan[i];
    const auto& [progress, result, updates, target, index, log, failure] = status.runs[i];
    text +=
        fmt::format("{} {:>4} {:<8} {:>9}/{} {}", run.id, index ? fmt::format("{}", *index) : "-",
                    RunProgressName(progress), updates, target, run.name);
    if (result) text += fmt::format(", {:.1f}", result->score.value_or(result->mean_return));
    if (!failure.empty()) {
      text += ": " + failure;  // which names the log, if it says more
    } else if (!log.empty() && progress != RunProgress::kDone) {
      text += ", " + log;
    }
    text += '\n';
  }
  return text + fmt::format(
                    "{} runs: {} done, {} running, {} begun, {} waiting, {} failed, {} diverged; "
                    "{} of {} cells filled; {:.1f} core-hours trained, about {:.1f} left\n",
                    plan.size(), status.CountOf(RunProgress::kDone),
                    status.CountOf(RunProgress::kRunning), status.CountOf(RunProgress::kBegun),
                    status.CountOf(RunProgress::kWaiting), status.CountOf(RunProgress::kFailed),
                    status.CountOf(RunProgress::kDiverged), status.filled, status.cells,
                    status.seconds / 3600, status.seconds_left / 3600);
}

std::string JsonOf(const std::vector<PlannedRun>& plan, const PlanStatus& status) {
  Json runs = Json::array();
  for (size_t i = 0; i < plan.size(); ++i) {
    const PlannedRun& run = plan[i];
    const auto& [progress, result, updates, target, index, log, failure] = status.runs[i];
    runs.push_back({{"name", run.name},
                    {"id", run.id},
                    {"cell", run.cell_id},
                    {"algorithm", run.algorithm},
                    {"environment", run.environment},
                    {"simulator", run.simulator},
                    {"dataset", run.full_dataset},
                    {"corruption", run.corruption},
                    {"world", run.world},
                    {"seed", run.seed},
                    {"precision", run.precision},
                    {"recipe", run.recipe},
                    {"hyperparameters", AsJson(run.hyperparameters)},
                    {"benchmarks", run.benchmarks},
                    {"planned_updates", run.updates},
                    {"updates", updates},
                    {"target", target},
                    {"state", RunProgressName(progress)},
                    {"done", progress == RunProgress::kDone},
                    {"index", index ? Json(*index) : Json()},
                    {"log", log.empty() ? Json() : Json(log)},
                    {"failure", failure.empty() ? Json() : Json(failure)},
                    {"score", result && result->score ? Json(*result->score) : Json()},
                    {"return", result ? Json(result->mean_return) : Json()},
                    {"seconds", result ? result->seconds : 0}});
  }
  return runs.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace b4mrl
