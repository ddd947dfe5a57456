// Estimates over the runs of many benchmarks, as rliable defines them (Agarwal et al., "Deep
// reinforcement learning at the edge of the statistical precipice", NeurIPS 2021). Pure functions;
// any thread.
#pragma once

#include <span>
#include <vector>

namespace b4mrl {

// The scores of one algorithm: scores[benchmark][run]. Benchmarks may differ in their number of
// runs (seeds); each has at least one, and there is at least one benchmark.
using Scores = std::vector<std::vector<double>>;

// From `low` to `high`, both included.
struct Interval {
  double low = 0;
  double high = 0;
};

// The quantile `q` in [0, 1] of at least one value, interpolated linearly between neighbours in
// order of size (numpy.quantile's default).
double Quantile(std::span<const double> values, double q);

inline double Median(std::span<const double> values) { return Quantile(values, 0.5); }

// The mean of what is left when the lowest and the highest quarter are cut off, each rounded down
// to a whole number of values (scipy.stats.trim_mean(values, 0.25)).
double InterquartileMean(std::span<const double> values);

// All runs of all benchmarks pooled, each run with equal weight: a benchmark with more runs weighs
// more.
double InterquartileMean(const Scores& scores);

// The mean of each benchmark's runs.
std::vector<double> MeanOfEach(const Scores& scores);

// The mean and the median over the benchmarks of each one's mean score: every benchmark weighs the
// same, however many runs it has.
double MeanOverBenchmarks(const Scores& scores);
double MedianOverBenchmarks(const Scores& scores);

// How likely a run of `x` scores higher than a run of `y` on the same benchmark, equal scores
// counted half: the mean over benchmarks of that share among all pairs of runs. x[b] and y[b] are
// of the same benchmark; their numbers of runs may differ.
double ProbabilityOfImprovement(const Scores& x, const Scores& y);

// For each threshold, the share of a benchmark's runs with a score above it, as the mean over the
// benchmarks: with equally many runs in each, the share of all runs.
std::vector<double> PerformanceProfile(const Scores& scores, std::span<const double> thresholds);

}  // namespace b4mrl
