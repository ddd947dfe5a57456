#include "benchmarks/statistics/estimates.h"

#include <algorithm>
#include <cmath>

#include "proto/base/mean_and_std.h"

namespace b4mrl {
namespace {

std::vector<double> Sorted(std::span<const double> values) {
  std::vector<double> sorted(values.begin(), values.end());
  std::sort(sorted.begin(), sorted.end());
  return sorted;
}

std::vector<double> Pooled(const Scores& scores) {
  std::vector<double> pooled;
  for (const std::vector<double>& runs : scores) {
    pooled.insert(pooled.end(), runs.begin(), runs.end());
  }
  return pooled;
}

// One benchmark's probability of improvement.
double ShareOfWins(const std::vector<double>& x, const std::vector<double>& y) {
  size_t halves = 0;
  for (const double a : x) {
    for (const double b : y) halves += a > b ? 2 : a == b ? 1 : 0;
  }
  return static_cast<double>(halves) / static_cast<double>(2 * x.size() * y.size());
}

}  // namespace

double Quantile(std::span<const double> values, double q) {
  const std::vector<double> sorted = Sorted(values);
  const double place = q * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<size_t>(place);
  const size_t above = std::min(below + 1, sorted.size() - 1);
  return std::lerp(sorted[below], sorted[above], place - static_cast<double>(below));
}

double InterquartileMean(std::span<const double> values) {
  const std::vector<double> sorted = Sorted(values);
  const size_t cut = sorted.size() / 4;
  return MeanAndStdOf(std::span(sorted).subspan(cut, sorted.size() - 2 * cut)).mean;
}

double InterquartileMean(const Scores& scores) { return InterquartileMean(Pooled(scores)); }

std::vector<double> MeanOfEach(const Scores& scores) {
  std::vector<double> means;
  means.reserve(scores.size());
  for (const std::vector<double>& runs : scores) means.push_back(MeanAndStdOf(runs).mean);
  return means;
}

double MeanOverBenchmarks(const Scores& scores) { return MeanAndStdOf(MeanOfEach(scores)).mean; }

double MedianOverBenchmarks(const Scores& scores) { return Median(MeanOfEach(scores)); }

double ProbabilityOfImprovement(const Scores& x, const Scores& y) {
  std::vector<double> shares;
  shares.reserve(x.size());
  for (size_t i = 0; i < x.size(); ++i) shares.push_back(ShareOfWins(x[i], y[i]));
  return MeanAndStdOf(shares).mean;
}

std::vector<double> PerformanceProfile(const Scores& scores, std::span<const double> thresholds) {
  std::vector<double> profile;
  profile.reserve(thresholds.size());
  for (const double threshold : thresholds) {
    std::vector<double> shares;
    shares.reserve(scores.size());
    for (const std::vector<double>& runs : scores) {
      const auto above =
          std::ranges::count_if(runs, [&](double score) { return score > threshold; });
      shares.push_back(static_cast<double>(above) / static_cast<double>(runs.size()));
    }
    profile.push_back(MeanAndStdOf(shares).mean);
  }
  return profile;
}

}  // namespace b4mrl
