#include "benchmarks/runner/plan_status.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <nlohmann/json.hpp>

#include "benchmarks/runner/cost.h"

namespace b4mrl {

PlanStatus StatusOf(const std::vector<PlannedRun>& plan, const std::string& results_folder) {
  PlanStatus status;
  CostModel costs;
  for (const PlannedRun& run : plan) {
    const auto read = ReadResult(ResultPath(results_folder, run));
    status.results.push_back(read.ok() ? *read : std::nullopt);
    if (!read.ok()) status.unreadable.push_back(read.status().message());
    if (status.results.back()) costs.Learn(run, *status.results.back());
  }
  for (size_t i = 0; i < plan.size(); ++i) {
    const PlannedRun& run = plan[i];
    const std::optional<RunResult>& result = status.results[i];
    const bool is_done = result && result->IsDone(run, run.updates);
    status.done += is_done ? 1 : 0;
    status.begun += result && !is_done ? 1 : 0;
    status.cells += run.benchmarks.size();
    status.filled += is_done ? run.benchmarks.size() : 0;
    status.seconds += result ? result->seconds : 0;
    const uint64_t updates = result ? std::min(result->updates, run.updates) : 0;
    if (is_done) continue;
    status.seconds_left += costs.SecondsOf(run, static_cast<double>(run.updates - updates));
  }
  return status;
}

std::string TextOf(const std::vector<PlannedRun>& plan, const PlanStatus& status) {
  std::string text;
  for (size_t i = 0; i < plan.size(); ++i) {
    const PlannedRun& run = plan[i];
    const std::optional<RunResult>& result = status.results[i];
    const std::string score =
        !result ? "" : fmt::format(", {:.1f}", result->score.value_or(result->mean_return));
    text += fmt::format("{} {:>9}/{} {}{}\n", run.id, result ? result->updates : 0, run.updates,
                        run.name, score);
  }
  return text + fmt::format(
                    "{} runs: {} done, {} begun; {} of {} cells filled; {:.1f} core-hours trained, "
                    "about {:.1f} left\n",
                    plan.size(), status.done, status.begun, status.filled, status.cells,
                    status.seconds / 3600, status.seconds_left / 3600);
}

std::string JsonOf(const std::vector<PlannedRun>& plan, const PlanStatus& status) {
  using Json = nlohmann::ordered_json;
  Json runs = Json::array();
  for (size_t i = 0; i < plan.size(); ++i) {
    const PlannedRun& run = plan[i];
    const std::optional<RunResult>& result = status.results[i];
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
                    {"hyperparameters", run.hyperparameters},
                    {"benchmarks", run.benchmarks},
                    {"planned_updates", run.updates},
                    {"updates", result ? result->updates : 0},
                    {"done", result && result->IsDone(run, run.updates)},
                    {"score", result && result->score ? Json(*result->score) : Json()},
                    {"return", result ? Json(result->mean_return) : Json()},
                    {"seconds", result ? result->seconds : 0}});
  }
  return runs.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace b4mrl
