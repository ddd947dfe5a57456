// Estimates over many benchmarks, with intervals: what an algorithm is worth on the whole.
//
// Compared are series that have settled cells on the same benchmarks, eight of them or more. There
// each cell of a series counts once, and each pair of two series' cells, however many benchmarks
// the same runs fill: an online learner's single run stands for all datasets, an offline one's for
// all simulators. Intervals are of 95%, by a percentile bootstrap that draws cells and, inside
// them, runs; a series with fewer than eight cells has none. Pure functions; any thread; equal
// tables give equal numbers.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "benchmarks/evidence/score_table.h"
#include "benchmarks/evidence/scores.h"
#include "benchmarks/statistics/estimates.h"

namespace b4mrl {

inline constexpr size_t kLeastBenchmarks = 8;

struct Aggregate {
  Series series;
  size_t cells = 0;                      // different ones
  double iqm = 0, median = 0, mean = 0;  // of their scores
  std::optional<Interval> iqm_interval;
  std::optional<double> paper_iqm;  // of the paper's means of these cells, if it has all
  std::vector<double> profile;      // share of a cell's runs with a score above each threshold
  std::vector<Interval> profile_intervals;  // one a threshold, or none
};

// How likely a run of `better` scores higher than one of `worse` on the same benchmark.
struct Improvement {
  Series better, worse;
  double probability = 0.5;
  size_t pairs = 0;  // of different cells
  std::optional<Interval> interval;
};

struct Aggregates {
  std::vector<const Benchmark*> benchmarks;
  std::vector<double> thresholds;         // of the profiles: 0, 5, ..., 100
  std::vector<Aggregate> series;          // in the order of the table
  std::vector<Improvement> improvements;  // every pair once, the likelier winner first
};

// Which series: to each two that share kLeastBenchmarks or more and are not both in the best choice
// so far, others are added, each time the one that leaves the most shared, as long as those are
// enough. The choice of the most series counts, of equal ones that with the most benchmarks.
// Nothing if no two share so many.
std::optional<Aggregates> AggregatesOf(const ScoreTable& table, const CellScores& paper);

}  // namespace b4mrl
