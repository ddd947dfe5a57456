// Percentile bootstrap intervals, stratified by benchmark as rliable's: runs are drawn with
// replacement inside each benchmark and, where asked for, the benchmarks as well. Which runs and
// benchmarks a resample holds is a value that can be given from outside, so that another
// implementation's resamples can be used. Pure functions; any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "benchmarks/statistics/estimates.h"

namespace b4mrl {

// One draw with replacement from several algorithms' scores on the same benchmarks.
struct Resample {
  // The benchmark that stands at each place: the same for all algorithms, so that what is compared
  // between them is compared on the same benchmarks.
  std::vector<size_t> benchmarks;
  // runs[algorithm][place]: the drawn runs of the benchmark at that place. Algorithms' runs are
  // drawn independently: equal seeds of two algorithms have nothing in common.
  std::vector<std::vector<std::vector<size_t>>> runs;
};

// What the resample holds, for each algorithm [place][drawn run]. `algorithms` have equally many
// benchmarks, and the resample's indices lie within them.
std::vector<Scores> Resampled(std::span<const Scores> algorithms, const Resample& resample);

enum class Resampling {
  // How the estimate would vary with other seeds on the same benchmarks. It has no width where
  // benchmarks have a single run each.
  kRuns,
  // How it would vary with other benchmarks of the same kind as well (rliable's `task_bootstrap`).
  kRunsAndBenchmarks,
};

// The resample of that number, a function of its arguments alone: as many benchmarks, and of each
// as many runs, as there are.
Resample DrawResample(std::span<const Scores> algorithms, Resampling resampling, uint64_t seed,
                      size_t number);

// What is estimated from the scores of the algorithms: one number, or several, such as a profile's.
using Statistic = std::function<std::vector<double>(std::span<const Scores>)>;

// The statistic of `count` resamples, [resample][number]; `draw` returns the resample of a number
// below `count`.
std::vector<std::vector<double>> BootstrapEstimates(std::span<const Scores> algorithms,
                                                    const Statistic& statistic, size_t count,
                                                    const std::function<Resample(size_t)>& draw);

// For each number of the statistic, the central share `confidence` of its estimates: from quantile
// (1 - confidence) / 2 to (1 + confidence) / 2. At least one resample.
std::vector<Interval> PercentileIntervals(const std::vector<std::vector<double>>& estimates,
                                          double confidence);

// Both of the above with resamples from DrawResample.
struct BootstrapOptions {
  Resampling resampling = Resampling::kRuns;
  size_t resamples = 2000;
  double confidence = 0.95;
  uint64_t seed = 0;
};
std::vector<Interval> BootstrapIntervals(std::span<const Scores> algorithms,
                                         const Statistic& statistic,
                                         const BootstrapOptions& options);

}  // namespace b4mrl
