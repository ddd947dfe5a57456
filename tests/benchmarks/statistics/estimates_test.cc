// The expected numbers are numpy's and scipy's, made by
//   v = [12.5, -3.0, 88.25, 41.0, 41.0, 7.75, 65.5, 19.0, 30.25, -1.5]
//   [scipy.stats.trim_mean(v[:n], 0.25) for n in (1, 3, 4, 7, 10)]
//   [numpy.quantile(v, q) for q in (0, 0.025, 0.25, 0.5, 0.9, 1)]
//   [scipy.stats.mannwhitneyu(a, b).statistic / (len(a) * len(b)) for a, b in zip(x, y)]
// Each is a handful of roundings away: 1e-14 of its size.
#include "benchmarks/statistics/estimates.h"

#include <catch2/catch.hpp>

namespace b4mrl {
namespace {

const std::vector<double> kValues = {12.5, -3.0, 88.25, 41.0, 41.0, 7.75, 65.5, 19.0, 30.25, -1.5};

Approx Near(double value) { return Approx(value).epsilon(1e-14); }

TEST_CASE("The interquartile mean cuts a quarter off each end, rounded down") {
  const auto of_first = [](size_t count) {
    return InterquartileMean(std::span(kValues).first(count));
  };
  CHECK(of_first(1) == 12.5);
  CHECK(of_first(3) == Near(32.583333333333336));
  CHECK(of_first(4) == Near(26.75));
  CHECK(of_first(7) == Near(33.55));
  CHECK(of_first(10) == Near(25.25));
}

TEST_CASE("Quantiles lie between their neighbours as numpy's do") {
  CHECK(Quantile(kValues, 0) == -3.0);
  CHECK(Quantile(kValues, 0.025) == Near(-2.6625));
  CHECK(Quantile(kValues, 0.25) == Near(8.9375));
  CHECK(Quantile(kValues, 0.9) == Near(67.77499999999999));
  CHECK(Quantile(kValues, 1) == 88.25);
  CHECK(Median(kValues) == Near(24.625));
  CHECK(Median(std::vector<double>{7}) == 7);
}

TEST_CASE("Benchmarks weigh the same in means and medians over benchmarks, runs in pooled ones") {
  const Scores scores = {{10, 20, 30}, {100}, {1, 3}};
  CHECK(MeanOverBenchmarks(scores) == Near((20.0 + 100 + 2) / 3));
  CHECK(MedianOverBenchmarks(scores) == 20);
  CHECK(InterquartileMean(scores) == Near((3.0 + 10 + 20 + 30) / 4));
}

TEST_CASE("The probability of improvement counts pairs of runs, and ties half") {
  const Scores x = {{10, 20, 30}, {5, 5}, {1, 2, 3, 4}};
  const Scores y = {{15, 20}, {5}, {4, 0, 2.5}};
  CHECK(ProbabilityOfImprovement(x, y) ==
        Near((0.5833333333333334 + 0.5 + 0.5416666666666666) / 3));
  CHECK(ProbabilityOfImprovement(x, y) + ProbabilityOfImprovement(y, x) == Near(1));
  CHECK(ProbabilityOfImprovement({{2}, {3}}, {{1}, {3}}) == 0.75);
}

TEST_CASE("A profile is the share of runs above each threshold, each benchmark with equal weight") {
  const std::vector<double> thresholds = {-1, 10, 20, 29.5, 30};
  CHECK(PerformanceProfile({{10, 20}, {30, 20}}, thresholds) ==
        std::vector<double>{1, 0.75, 0.25, 0.25, 0});
  CHECK(PerformanceProfile({{10, 20, 30, 40}, {20}}, thresholds) ==
        std::vector<double>{1, 0.875, 0.25, 0.25, 0.125});
}

}  // namespace
}  // namespace b4mrl
