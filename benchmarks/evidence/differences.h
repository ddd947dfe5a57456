// How many points our scores lie from the paper's. Each run counts once, however many benchmarks it
// fills; runs on other rows than those published count nowhere. Pure functions; any thread.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "benchmarks/evidence/scores.h"
#include "data/suites/suites.h"

namespace b4mrl {

// How high an algorithm's scores are beside the paper's.
struct ScoreLevel {
  std::string algorithm;
  size_t runs = 0, lower = 0;  // that the paper has too; of them, below the paper's
  double difference = 0;       // mean of ours minus the paper's
  size_t settled_runs = 0;
  double settled_difference = 0;
};
// In the field's order; algorithms without such a run are left out.
std::vector<ScoreLevel> ScoreLevels(const CellScores& paper, const CellScores& ours,
                                    const std::vector<Benchmark>& benchmarks);

// A cell whose score and the paper's differ.
struct Deviation {
  std::string benchmark, algorithm;  // of the first benchmark that its run fills
  CellScore ours;
  double paper = 0;
};
// The cells that differ by more than `points`, in the order of the benchmarks.
std::vector<Deviation> Deviations(const CellScores& paper, const CellScores& ours,
                                  const std::vector<Benchmark>& benchmarks, double points);

}  // namespace b4mrl
