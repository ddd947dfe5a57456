#include "benchmarks/statistics/bootstrap.h"

#include <numeric>

#include "proto/base/rng.h"

namespace b4mrl {

std::vector<Scores> Resampled(std::span<const Scores> algorithms, const Resample& resample) {
  std::vector<Scores> resampled(algorithms.size());
  for (size_t i = 0; i < algorithms.size(); ++i) {
    resampled[i].resize(resample.benchmarks.size());
    for (size_t place = 0; place < resample.benchmarks.size(); ++place) {
      const std::vector<double>& scores = algorithms[i][resample.benchmarks[place]];
      std::vector<double>& drawn = resampled[i][place];
      drawn.reserve(resample.runs[i][place].size());
      for (const size_t run : resample.runs[i][place]) drawn.push_back(scores[run]);
    }
  }
  return resampled;
}

Resample DrawResample(std::span<const Scores> algorithms, Resampling resampling, uint64_t seed,
                      size_t number) {
  Resample resample;
  resample.benchmarks.resize(algorithms[0].size());
  std::iota(resample.benchmarks.begin(), resample.benchmarks.end(), size_t{0});
  if (resampling == Resampling::kRunsAndBenchmarks) {
    Rng rng(seed, "bootstrap-benchmarks", number);
    for (size_t& benchmark : resample.benchmarks) benchmark = rng.Below(algorithms[0].size());
  }
  Rng rng(seed, "bootstrap-runs", number);
  resample.runs.resize(algorithms.size());
  for (size_t i = 0; i < algorithms.size(); ++i) {
    for (const size_t benchmark : resample.benchmarks) {
      std::vector<size_t>& runs = resample.runs[i].emplace_back(algorithms[i][benchmark].size());
      for (size_t& run : runs) run = rng.Below(runs.size());
    }
  }
  return resample;
}

std::vector<std::vector<double>> BootstrapEstimates(std::span<const Scores> algorithms,
                                                    const Statistic& statistic, size_t count,
                                                    const std::function<Resample(size_t)>& draw) {
  std::vector<std::vector<double>> estimates;
  estimates.reserve(count);
  for (size_t number = 0; number < count; ++number) {
    estimates.push_back(statistic(Resampled(algorithms, draw(number))));
  }
  return estimates;
}

std::vector<Interval> PercentileIntervals(const std::vector<std::vector<double>>& estimates,
                                          double confidence) {
  std::vector<Interval> intervals;
  std::vector<double> column(estimates.size());
  for (size_t i = 0; i < estimates[0].size(); ++i) {
    for (size_t row = 0; row < estimates.size(); ++row) column[row] = estimates[row][i];
    intervals.push_back(
        {Quantile(column, (1 - confidence) / 2), Quantile(column, (1 + confidence) / 2)});
  }
  return intervals;
}

std::vector<Interval> BootstrapIntervals(std::span<const Scores> algorithms,
                                         const Statistic& statistic,
                                         const BootstrapOptions& options) {
  const auto draw = [&](size_t number) {
    return DrawResample(algorithms, options.resampling, options.seed, number);
  };
  return PercentileIntervals(BootstrapEstimates(algorithms, statistic, options.resamples, draw),
                             options.confidence);
}

}  // namespace b4mrl
