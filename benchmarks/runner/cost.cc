#include "benchmarks/runner/cost.h"

#include <fmt/format.h>

#include <string_view>
#include <utility>

namespace b4mrl {
namespace {

// Updates a second in fp32 (benchmarks/RESULTS.md), evaluations, ensembles and rollouts included.
constexpr std::pair<std::string_view, double> kUpdatesPerSecond[] = {
    {"sac", 150}, {"td3", 200}, {"bc", 600}, {"td3-bc", 205},
    {"iql", 150}, {"mopo", 88}, {"h2o", 63}, {"hymopo", 76},
};
constexpr double kOfOthers = 100;

std::string KeyOf(const PlannedRun& run) {
  return fmt::format("{} {} {} {}", run.environment, run.algorithm, run.recipe, run.precision);
}

double DefaultRate(std::string_view algorithm) {
  for (const auto& [name, rate] : kUpdatesPerSecond) {
    if (name == algorithm) return rate;
  }
  return kOfOthers;
}

}  // namespace

void CostModel::Learn(const PlannedRun& run, const RunResult& result) {
  if (result.updates == 0 || !(result.seconds > 0)) return;
  Sum& sum = learned_[KeyOf(run)];
  sum.seconds += result.seconds;
  sum.updates += static_cast<double>(result.updates);
}

double CostModel::SecondsOf(const PlannedRun& run, double updates) const {
  const auto found = learned_.find(KeyOf(run));
  if (found == learned_.end()) return updates / DefaultRate(run.algorithm);
  return updates * found->second.seconds / found->second.updates;
}

}  // namespace b4mrl
