#include "benchmarks/evidence/aggregates.h"

#include <algorithm>
#include <set>
#include <span>
#include <string>
#include <utility>

#include "benchmarks/statistics/bootstrap.h"

namespace b4mrl {
namespace {

// Means of few benchmarks jump between resamples: after 2,000 of them a limit still depends on the
// draw.
constexpr BootstrapOptions kBootstrap = {.resampling = Resampling::kRunsAndBenchmarks,
                                         .resamples = 50'000,
                                         .confidence = 0.95,
                                         .seed = 0};
constexpr double kProfileStep = 5;
constexpr double kProfileEnd = 100;

using Benchmarks = std::vector<const Benchmark*>;

// A cell that may be compared; null otherwise.
const Cell* Decided(const ScoreTable& table, const Benchmark& benchmark, const Series& series) {
  const Cell* cell = table.Find(benchmark.name, series);
  const bool counts = cell != nullptr && cell->IsSettled() && !cell->runs.front()->is_return;
  return counts ? cell : nullptr;
}

// Of the benchmarks those on which all series have a cell, each set of runs once.
Benchmarks Distinct(const ScoreTable& table, const std::vector<Series>& series,
                    const Benchmarks& benchmarks) {
  Benchmarks distinct;
  std::set<std::string> seen;
  for (const Benchmark* benchmark : benchmarks) {
    std::string runs;
    const bool all = std::ranges::all_of(series, [&](const Series& each) {
      const Cell* cell = Decided(table, *benchmark, each);
      if (cell != nullptr) runs += cell->runs.front()->id;
      return cell != nullptr;
    });
    if (all && seen.insert(runs).second) distinct.push_back(benchmark);
  }
  return distinct;
}

Benchmarks Shared(const ScoreTable& table, const std::vector<Series>& series) {
  return Distinct(table, series, table.benchmarks());
}

// Series that are compared, and where.
struct Choice {
  std::vector<Series> series;
  Benchmarks benchmarks;

  bool Has(const Series& each) const { return std::ranges::find(series, each) != series.end(); }
  // Adds, one after another, the series that leaves the most benchmarks, as long as enough are.
  void Grow(const ScoreTable& table) {
    while (true) {
      Choice best;
      for (const Series& each : table.series()) {
        if (Has(each)) continue;
        std::vector<Series> with = series;
        with.push_back(each);
        Benchmarks shared = Shared(table, with);
        if (shared.size() < kLeastBenchmarks || shared.size() <= best.benchmarks.size()) continue;
        best = {std::move(with), std::move(shared)};
      }
      if (best.series.empty()) return;
      *this = std::move(best);
    }
  }
  auto Rank() const { return std::pair(series.size(), benchmarks.size()); }
};

// With the series in the order of the table.
Choice Choose(const ScoreTable& table) {
  const std::vector<Series>& all = table.series();
  Choice best;
  for (size_t i = 0; i < all.size(); ++i) {
    for (size_t j = i + 1; j < all.size(); ++j) {
      if (best.Has(all[i]) && best.Has(all[j])) continue;
      Choice choice = {{all[i], all[j]}, Shared(table, {all[i], all[j]})};
      if (choice.benchmarks.size() < kLeastBenchmarks) continue;
      choice.Grow(table);
      if (choice.Rank() > best.Rank()) best = std::move(choice);
    }
  }
  Choice in_order = {all, best.benchmarks};
  std::erase_if(in_order.series, [&](const Series& each) { return !best.Has(each); });
  return in_order;
}

Scores ScoresOf(const ScoreTable& table, const Series& series, const Benchmarks& benchmarks) {
  Scores scores;
  for (const Benchmark* benchmark : benchmarks) {
    scores.push_back(table.Find(benchmark->name, series)->Scores());
  }
  return scores;
}

std::optional<double> PaperIqm(const CellScores& paper, const std::string& algorithm,
                               const Benchmarks& benchmarks) {
  std::vector<double> means;
  for (const Benchmark* benchmark : benchmarks) {
    const CellScore* score = Find(paper, benchmark->name, algorithm);
    if (score == nullptr) return std::nullopt;
    means.push_back(score->mean);
  }
  return InterquartileMean(means);
}

Aggregate AggregateOf(const Scores& scores, const std::vector<double>& thresholds) {
  Aggregate aggregate;
  aggregate.cells = scores.size();
  const bool by_means = std::ranges::any_of(scores, [&](const std::vector<double>& runs) {
    return runs.size() != scores.front().size();
  });
  // Where benchmarks differ in their number of runs, each stands by the mean of its runs: pooled,
  // one with more seeds would weigh more.
  const auto iqm_of = [by_means](const Scores& of_any) {
    return by_means ? InterquartileMean(MeanOfEach(of_any)) : InterquartileMean(of_any);
  };
  aggregate.iqm = iqm_of(scores);
  aggregate.median = MedianOverBenchmarks(scores);
  aggregate.mean = MeanOverBenchmarks(scores);
  aggregate.profile = PerformanceProfile(scores, thresholds);
  if (scores.size() < kLeastBenchmarks) return aggregate;
  // The interquartile mean first, then the profile.
  const auto statistic = [&](std::span<const Scores> drawn) {
    std::vector<double> numbers = {iqm_of(drawn[0])};
    std::ranges::copy(PerformanceProfile(drawn[0], thresholds), std::back_inserter(numbers));
    return numbers;
  };
  std::vector<Interval> intervals = BootstrapIntervals({&scores, 1}, statistic, kBootstrap);
  aggregate.iqm_interval = intervals.front();
  aggregate.profile_intervals.assign(intervals.begin() + 1, intervals.end());
  return aggregate;
}

Improvement ImprovementOf(const ScoreTable& table, const Series& one, const Series& other,
                          const Benchmarks& benchmarks, bool has_interval) {
  const Benchmarks pairs = Distinct(table, {one, other}, benchmarks);
  std::vector<Scores> both = {ScoresOf(table, one, pairs), ScoresOf(table, other, pairs)};
  Improvement improvement = {.better = one, .worse = other, .pairs = pairs.size()};
  improvement.probability = ProbabilityOfImprovement(both[0], both[1]);
  if (improvement.probability < 0.5) {
    std::swap(both[0], both[1]);
    std::swap(improvement.better, improvement.worse);
    improvement.probability = ProbabilityOfImprovement(both[0], both[1]);
  }
  if (!has_interval) return improvement;
  const auto statistic = [](std::span<const Scores> drawn) {
    return std::vector{ProbabilityOfImprovement(drawn[0], drawn[1])};
  };
  improvement.interval = BootstrapIntervals(both, statistic, kBootstrap).front();
  return improvement;
}

}  // namespace

std::optional<Aggregates> AggregatesOf(const ScoreTable& table, const CellScores& paper) {
  auto [series, benchmarks] = Choose(table);
  if (series.empty()) return std::nullopt;
  Aggregates aggregates;
  for (double at = 0; at <= kProfileEnd; at += kProfileStep) aggregates.thresholds.push_back(at);
  for (const Series& each : series) {
    const Benchmarks cells = Distinct(table, {each}, benchmarks);
    aggregates.series.push_back(AggregateOf(ScoresOf(table, each, cells), aggregates.thresholds));
    aggregates.series.back().series = each;
    aggregates.series.back().paper_iqm = PaperIqm(paper, each.algorithm, cells);
  }
  for (size_t i = 0; i < series.size(); ++i) {
    for (size_t j = i + 1; j < series.size(); ++j) {
      const bool has_interval = aggregates.series[i].iqm_interval.has_value() &&
                                aggregates.series[j].iqm_interval.has_value();
      aggregates.improvements.push_back(
          ImprovementOf(table, series[i], series[j], benchmarks, has_interval));
    }
  }
  aggregates.benchmarks = std::move(benchmarks);
  return aggregates;
}

}  // namespace b4mrl
