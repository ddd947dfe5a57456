#include "benchmarks/evidence/hybrid_gain.h"

#include <algorithm>
#include <string_view>
#include <tuple>

namespace b4mrl {
namespace {

constexpr const char* kSingles[kSingleSourceAlgorithms] = {"td3",  "sac",    "bc",
                                                           "mopo", "td3-bc", "iql"};
constexpr std::string_view kNotInThePaper = "bc";

}  // namespace

std::vector<HybridGain> HybridGains(const CellScores& scores,
                                    const std::vector<Benchmark>& benchmarks) {
  std::vector<HybridGain> gains;
  for (const Benchmark& benchmark : benchmarks) {
    if (benchmark.dataset.empty() || benchmark.simulator.empty()) continue;
    HybridGain common;
    common.benchmark = benchmark.name;
    const CellScore* best = nullptr;
    bool all_settled = true;
    for (const char* single : kSingles) {
      const CellScore* score = Find(scores, benchmark.name, single);
      if (score == nullptr) {
        common.has_papers &= single == kNotInThePaper;
        continue;
      }
      ++common.compared;
      all_settled &= score->settled;
      if (best != nullptr && best->mean >= score->mean) continue;
      best = score;
      common.best = single;
      common.best_recipe = score->recipe;
    }
    if (best == nullptr) continue;
    std::vector<HybridGain> of_benchmark;
    for (auto entry = scores.lower_bound({benchmark.name, ""});
         entry != scores.end() && entry->first.first == benchmark.name; ++entry) {
      const auto& [name, score] = *entry;
      if (std::ranges::find(kSingles, name.second) != std::end(kSingles)) continue;
      if (score.has_one_source) continue;
      HybridGain gain = common;
      gain.algorithm = name.second;
      gain.recipe = score.recipe;
      gain.gain = score.mean - best->mean;
      gain.settled = all_settled && score.settled;
      of_benchmark.push_back(std::move(gain));
    }
    std::ranges::stable_sort(of_benchmark, {}, [](const HybridGain& gain) {
      return std::tuple(OrderOf(gain.algorithm), gain.algorithm);
    });
    std::ranges::move(of_benchmark, std::back_inserter(gains));
  }
  return gains;
}

std::map<CellName, HybridGain> ByCell(const std::vector<HybridGain>& gains) {
  std::map<CellName, HybridGain> by_cell;
  for (const HybridGain& gain : gains) by_cell[{gain.benchmark, gain.algorithm}] = gain;
  return by_cell;
}

}  // namespace b4mrl
