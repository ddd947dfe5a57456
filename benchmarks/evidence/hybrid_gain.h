// Hybrid gain: a hybrid's score minus that of the best algorithm with one source on the same
// benchmark. Above 0, the two sources together are worth more than either alone. Pure functions;
// any thread.
#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "benchmarks/evidence/scores.h"
#include "data/suites/suites.h"

namespace b4mrl {

// TD3, SAC, BC, MOPO, TD3-BC, IQL.
inline constexpr size_t kSingleSourceAlgorithms = 6;

struct HybridGain {
  std::string benchmark;
  std::string algorithm;  // a hybrid, or a user's own that is not known to use one source alone
  std::string recipe;     // of its score
  double gain = 0;        // points
  std::string best;       // the best algorithm with one source
  std::string best_recipe;
  size_t compared = 0;     // algorithms with one source that have a score
  bool has_papers = true;  // of them all that the paper compares with: all but BC
  bool settled = false;    // all scores that it rests on have settled
};

// On every benchmark with a simulator and a dataset, for each hybrid with a score beside an
// algorithm with one source; in the order of the benchmarks, there of the field (OrderOf).
std::vector<HybridGain> HybridGains(const CellScores& scores,
                                    const std::vector<Benchmark>& benchmarks);

// The same, to be found by benchmark and hybrid.
std::map<CellName, HybridGain> ByCell(const std::vector<HybridGain>& gains);

}  // namespace b4mrl
