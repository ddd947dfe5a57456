// Figures with lines: learning curves, and profiles over many benchmarks.
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "algorithms/pictures/fit.h"
#include "benchmarks/pages/entries.h"
#include "benchmarks/pages/figures.h"
#include "proto/base/mean_and_std.h"

namespace b4mrl {
namespace {

constexpr double kThousand = 1000;
constexpr size_t kPanelsOfAPicture = 6;  // which a printed page has room for

// A curve's mean over the runs of a cell after each evaluation that all of them have.
struct MeanCurve {
  std::vector<double> updates, mean, low, high;
};

MeanCurve MeanCurveOf(const Cell& cell) {
  std::map<uint64_t, std::vector<double>> scores;
  for (const ScoredRun* run : cell.runs) {
    for (const CurvePoint& point : run->curve) {
      scores[point.updates].push_back(point.score.value_or(point.mean_return));
    }
  }
  MeanCurve curve;
  for (const auto& [updates, values] : scores) {
    if (values.size() < cell.runs.size()) continue;
    const MeanAndStd figures = MeanAndStdOf(values);
    curve.updates.push_back(static_cast<double>(updates) / kThousand);
    curve.mean.push_back(figures.mean);
    curve.low.push_back(figures.mean - figures.std);
    curve.high.push_back(figures.mean + figures.std);
  }
  return curve;
}

std::set<std::string> RunsOf(const ScoreTable& table, const Benchmark& benchmark) {
  std::set<std::string> runs;
  for (const Series& series : table.series()) {
    const Cell* cell = table.Find(benchmark.name, series);
    if (cell == nullptr) continue;
    for (const ScoredRun* run : cell->runs) runs.insert(run->id);
  }
  return runs;
}

// The benchmarks of which no other one shows all runs too; of equal ones the first.
std::vector<const Benchmark*> Telling(const ScoreTable& table) {
  std::vector<std::pair<const Benchmark*, std::set<std::string>>> all;
  for (const Benchmark* benchmark : table.benchmarks()) {
    all.emplace_back(benchmark, RunsOf(table, *benchmark));
  }
  std::vector<const Benchmark*> telling;
  for (size_t i = 0; i < all.size(); ++i) {
    bool is_shown = false;
    for (size_t j = 0; j < all.size() && !is_shown; ++j) {
      const bool has_all = i != j && std::ranges::includes(all[j].second, all[i].second);
      is_shown = has_all && (j < i || all[j].second.size() > all[i].second.size());
    }
    if (!is_shown) telling.push_back(all[i].first);
  }
  return telling;
}

// One series for each of ours, in the colour of its algorithm; further recipes come behind.
struct NumberedSeries {
  std::vector<std::string> names;
  std::map<Series, size_t> numbers;
};

NumberedSeries NumberSeries(const Evidence& evidence) {
  const auto algorithms = AlgorithmsOf(evidence);
  NumberedSeries numbered = {SeriesNames(algorithms), {}};
  for (const Series& series : evidence.table.series()) {
    if (evidence.table.MainSeries(series.algorithm) == series) {
      numbered.numbers[series] =
          static_cast<size_t>(std::ranges::find(algorithms, series.algorithm) - algorithms.begin());
    } else {
      numbered.numbers[series] = numbered.names.size();
      numbered.names.push_back(DisplayName(series));
    }
  }
  return numbered;
}

Panel CurvesPanel(const ScoreTable& table, const Benchmark& benchmark,
                  const std::map<Series, size_t>& numbers) {
  Panel panel;
  panel.title = benchmark.name;
  panel.x = {.name = "updates", .unit = "thousands"};
  panel.y = {.name = "score", .unit = ""};
  for (const auto& [series, number] : numbers) {
    const Cell* cell = table.Find(benchmark.name, series);
    if (cell == nullptr) continue;
    MeanCurve curve = MeanCurveOf(*cell);
    if (curve.updates.empty()) continue;
    if (cell->runs.size() > 1) {
      panel.marks.emplace_back(Band{number, curve.updates, curve.low, curve.high});
    }
    panel.marks.emplace_back(Line{number, false, curve.updates, curve.mean});
  }
  FitX({&panel, 1});
  return panel;
}

}  // namespace

std::vector<Picture> CurvesPictures(const Evidence& evidence) {
  const auto [names, numbers] = NumberSeries(evidence);
  std::vector<Panel> panels;
  for (const Benchmark* benchmark : Telling(evidence.table)) {
    panels.push_back(CurvesPanel(evidence.table, *benchmark, numbers));
  }
  FitY(panels);
  std::vector<Picture> pictures;
  for (size_t i = 0; i < panels.size(); ++i) {
    if (i % kPanelsOfAPicture == 0) {
      Picture picture;
      picture.id = "learning-curves";
      if (i > 0) picture.id += fmt::format("-{}", pictures.size() + 1);
      picture.figure = {.title = i == 0 ? "Learning curves" : "Learning curves, continued",
                        .series = names,
                        .columns = 2,
                        .panel_width = 560,
                        .plot_height = 220};
      pictures.push_back(std::move(picture));
    }
    pictures.back().figure.panels.push_back(std::move(panels[i]));
  }
  return pictures;
}

Picture ProfilesPicture(const Evidence& evidence, const Aggregates& aggregates) {
  Picture picture;
  picture.id = "profiles";
  Figure& figure = picture.figure;
  figure.title = "Share of runs with a score above";
  figure.sentences = {
      fmt::format("Over {} benchmarks; bands are intervals of 95%.", aggregates.benchmarks.size())};
  auto [names, numbers] = NumberSeries(evidence);
  figure.series = std::move(names);
  Panel panel;
  panel.x = {.name = "normalised score", .unit = ""};
  panel.y = {.name = "share of runs", .unit = ""};
  for (const Aggregate& each : aggregates.series) {
    const size_t number = numbers.at(each.series);
    Band band = {number, aggregates.thresholds, {}, {}};
    for (const Interval& interval : each.profile_intervals) {
      band.low.push_back(interval.low);
      band.high.push_back(interval.high);
    }
    if (!band.low.empty()) panel.marks.emplace_back(std::move(band));
    panel.marks.emplace_back(Line{number, false, aggregates.thresholds, each.profile});
  }
  figure.panels = {std::move(panel)};
  FitX(figure.panels);
  FitY(figure.panels);
  return picture;
}

}  // namespace b4mrl
