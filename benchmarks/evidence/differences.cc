#include "benchmarks/evidence/differences.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>

namespace b4mrl {

std::vector<ScoreLevel> ScoreLevels(const CellScores& paper, const CellScores& ours,
                                    const std::vector<Benchmark>& benchmarks) {
  std::vector<ScoreLevel> levels;
  // Those without a dataset repeat the others' online runs, or have returns instead of scores.
  std::vector<Benchmark> with_dataset;
  std::ranges::copy_if(benchmarks, std::back_inserter(with_dataset),
                       [](const Benchmark& each) { return !each.dataset.empty(); });
  for (const Deviation& each : Deviations(paper, ours, with_dataset, -1)) {
    auto level = std::ranges::find(levels, each.algorithm, &ScoreLevel::algorithm);
    if (level == levels.end()) level = levels.insert(level, {.algorithm = each.algorithm});
    const double difference = each.ours.mean - each.paper;
    ++level->runs;
    level->lower += difference < 0 ? 1 : 0;
    level->difference += difference;
    if (!each.ours.settled) continue;
    ++level->settled_runs;
    level->settled_difference += difference;
  }
  for (ScoreLevel& level : levels) {
    level.difference /= static_cast<double>(level.runs);
    if (level.settled_runs > 0) level.settled_difference /= static_cast<double>(level.settled_runs);
  }
  std::ranges::stable_sort(levels, {},
                           [](const ScoreLevel& level) { return OrderOf(level.algorithm); });
  return levels;
}

std::vector<Deviation> Deviations(const CellScores& paper, const CellScores& ours,
                                  const std::vector<Benchmark>& benchmarks, double points) {
  std::vector<Deviation> deviations;
  std::set<std::string> counted;
  for (const Benchmark& benchmark : benchmarks) {
    for (const auto& [algorithm, unused] : benchmark.paper) {
      const CellScore* own = FindComparable(ours, benchmark.name, algorithm);
      if (own == nullptr) continue;
      if (!counted.insert(SharedRun(benchmark, algorithm)).second) continue;
      const double printed = Find(paper, benchmark.name, algorithm)->mean;
      if (std::abs(own->mean - printed) <= points) continue;
      deviations.push_back({benchmark.name, algorithm, *own, printed});
    }
  }
  return deviations;
}

}  // namespace b4mrl
