// The statistics of a question in JSON, for compare_rliable.py: reads it from standard input and
// prints the answer. Scores are [algorithm][benchmark][run]; resamples are objects with the members
// of Resample.
#include <iostream>
#include <nlohmann/json.hpp>

#include "benchmarks/statistics/bootstrap.h"
#include "benchmarks/statistics/estimates.h"

namespace {

using b4mrl::Scores;
using nlohmann::json;

// The statistics of the first algorithm, and of the first compared with the second if there is one,
// in this order: interquartile mean, median, mean, profile; or probability of improvement alone.
b4mrl::Statistic StatisticOf(const json& question) {
  const auto thresholds = question.at("thresholds").get<std::vector<double>>();
  return [thresholds](std::span<const Scores> algorithms) {
    if (algorithms.size() == 2) {
      return std::vector{b4mrl::ProbabilityOfImprovement(algorithms[0], algorithms[1])};
    }
    std::vector<double> numbers = {b4mrl::InterquartileMean(algorithms[0]),
                                   b4mrl::MedianOverBenchmarks(algorithms[0]),
                                   b4mrl::MeanOverBenchmarks(algorithms[0])};
    const std::vector<double> profile = b4mrl::PerformanceProfile(algorithms[0], thresholds);
    numbers.insert(numbers.end(), profile.begin(), profile.end());
    return numbers;
  };
}

}  // namespace

int main() {
  const json question = json::parse(std::cin);
  const auto algorithms = question.at("scores").get<std::vector<Scores>>();
  const b4mrl::Statistic statistic = StatisticOf(question);
  const json& resamples = question.at("resamples");
  const auto draw = [&](size_t number) {
    const json& resample = resamples.at(number);
    b4mrl::Resample result;
    resample.at("benchmarks").get_to(result.benchmarks);
    resample.at("runs").get_to(result.runs);
    return result;
  };
  json intervals = json::array();
  for (const b4mrl::Interval& interval : b4mrl::PercentileIntervals(
           b4mrl::BootstrapEstimates(algorithms, statistic, resamples.size(), draw), 0.95)) {
    intervals.push_back({interval.low, interval.high});
  }
  std::cout << json{{"points", statistic(algorithms)}, {"intervals", intervals}} << "\n";
}
