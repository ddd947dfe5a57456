#include "benchmarks/statistics/bootstrap.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>

#include "proto/base/rng.h"

namespace b4mrl {
namespace {

const std::vector<Scores> kRagged = {{{1, 2, 3}, {10}, {20, 21}}, {{4, 5}, {11, 12}, {30}}};

Statistic Mean() {
  return [](std::span<const Scores> algorithms) {
    return std::vector{MeanOverBenchmarks(algorithms[0])};
  };
}

bool SameResample(const Resample& a, const Resample& b) {
  return a.benchmarks == b.benchmarks && a.runs == b.runs;
}

TEST_CASE("A resample given from outside says which runs of which benchmarks are used") {
  const Resample resample = {.benchmarks = {2, 0, 0},
                             .runs = {{{1, 1}, {2, 0, 0}, {1, 1, 1}}, {{0}, {1, 1}, {0, 1}}}};
  CHECK(Resampled(kRagged, resample) ==
        std::vector<Scores>{{{21, 21}, {3, 1, 1}, {2, 2, 2}}, {{30}, {5, 5}, {4, 5}}});
}

TEST_CASE("Drawn resamples have the shape of the scores and stay within them") {
  const auto resampling = GENERATE(Resampling::kRuns, Resampling::kRunsAndBenchmarks);
  for (size_t number = 0; number < 50; ++number) {
    const Resample resample = DrawResample(kRagged, resampling, 3, number);
    REQUIRE(resample.benchmarks.size() == 3);
    if (resampling == Resampling::kRuns) {
      CHECK(resample.benchmarks == std::vector<size_t>{0, 1, 2});
    }
    REQUIRE(resample.runs.size() == 2);
    for (size_t algorithm = 0; algorithm < 2; ++algorithm) {
      REQUIRE(resample.runs[algorithm].size() == 3);
      for (size_t place = 0; place < 3; ++place) {
        REQUIRE(resample.benchmarks[place] < 3);
        const size_t count = kRagged[algorithm][resample.benchmarks[place]].size();
        const std::vector<size_t>& runs = resample.runs[algorithm][place];
        CHECK(runs.size() == count);
        CHECK(std::all_of(runs.begin(), runs.end(), [&](size_t run) { return run < count; }));
      }
    }
  }
}

TEST_CASE("A resample is a function of the seed and its number") {
  const auto draw = [](uint64_t seed, size_t number) {
    return DrawResample(kRagged, Resampling::kRunsAndBenchmarks, seed, number);
  };
  CHECK(SameResample(draw(1, 7), draw(1, 7)));
  CHECK_FALSE(SameResample(draw(1, 7), draw(1, 8)));
  CHECK_FALSE(SameResample(draw(1, 7), draw(2, 7)));
}

TEST_CASE("Single runs give no width unless benchmarks are drawn as well") {
  const std::vector<Scores> single = {{{10}, {20}, {40}, {80}}};
  const auto interval_of = [&](Resampling resampling) {
    return BootstrapIntervals(single, Mean(), {.resampling = resampling})[0];
  };
  const Interval runs = interval_of(Resampling::kRuns);
  CHECK(runs.low == 37.5);
  CHECK(runs.high == 37.5);
  const Interval benchmarks = interval_of(Resampling::kRunsAndBenchmarks);
  CHECK(benchmarks.low < 25);
  CHECK(benchmarks.high > 50);
}

TEST_CASE("What is equal for two algorithms on each benchmark cancels in their difference") {
  // The second algorithm is 5 better everywhere, however much benchmarks differ.
  const std::vector<Scores> pair = {{{0}, {50}, {100}}, {{5}, {55}, {105}}};
  const Statistic gain = [](std::span<const Scores> algorithms) {
    return std::vector{MeanOverBenchmarks(algorithms[1]) - MeanOverBenchmarks(algorithms[0]),
                       ProbabilityOfImprovement(algorithms[1], algorithms[0])};
  };
  const auto intervals =
      BootstrapIntervals(pair, gain, {.resampling = Resampling::kRunsAndBenchmarks});
  REQUIRE(intervals.size() == 2);
  CHECK(intervals[0].low == Approx(5));
  CHECK(intervals[0].high == Approx(5));
  CHECK(intervals[1].low == 1);
}

TEST_CASE("The interval of a mean of many runs has the width that theory gives") {
  // 400 normal values: the standard error of their mean is their deviation / 20.
  Scores scores(1, std::vector<double>(400));
  Rng(5, "test").FillNormal(std::span(scores[0]));
  double squares = 0;
  for (const double value : scores[0]) {
    squares += std::pow(value - MeanOverBenchmarks(scores), 2);
  }
  const double error = std::sqrt(squares / 400) / 20;
  const Interval interval = BootstrapIntervals(std::span(&scores, 1), Mean(), {})[0];
  // 2,000 resamples leave an end uncertain by 0.06 standard errors, so this is four times that.
  CHECK((interval.high - MeanOverBenchmarks(scores)) / error == Approx(1.96).margin(0.25));
  CHECK((MeanOverBenchmarks(scores) - interval.low) / error == Approx(1.96).margin(0.25));
}

TEST_CASE("Percentile intervals are quantiles of each column") {
  const std::vector<std::vector<double>> estimates = {{0, 5}, {40, 5}, {10, 5}, {20, 5}, {30, 5}};
  const auto intervals = PercentileIntervals(estimates, 0.8);  // quantiles 0.1 and 0.9
  REQUIRE(intervals.size() == 2);
  CHECK(intervals[0].low == Approx(4));
  CHECK(intervals[0].high == Approx(36));
  CHECK(intervals[1].low == 5);
  CHECK(intervals[1].high == 5);
}

}  // namespace
}  // namespace b4mrl
