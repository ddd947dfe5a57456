// Figures with lines: learning curves, and profiles over many benchmarks.
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "algorithms/pictures/fit.h"
#include "benchmarks/pages/figures.h"
#include "proto/base/mean_and_std.h"

namespace b4mrl {
namespace {

constexpr char kReturn[] = "return";  // the axis of tasks without scores
constexpr double kThousand = 1000;
constexpr double kLongestToShortest = 4;  // of the curves in one panel
constexpr size_t kPanelsOfAPicture = 6;   // which a printed page has room for

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

struct SeriesCurve {
  size_t number;  // of its series
  const Cell* cell;
  MeanCurve mean;
  double End() const { return mean.updates.back(); }
};

// Curves of one benchmark that are about equally long, with those that are too long for its panel.
struct CurveGroup {
  std::string title;
  std::vector<SeriesCurve> curves, longer;  // in the order of their series

  std::set<std::string> Runs() const {
    std::set<std::string> runs;
    for (const SeriesCurve& curve : curves) {
      for (const ScoredRun* run : curve.cell->runs) runs.insert(run->id);
    }
    return runs;
  }
};

std::string TitleOf(const Benchmark& benchmark, const std::vector<SeriesCurve>& curves,
                    bool are_shortest) {
  const bool use_data = std::ranges::any_of(
      curves, [](const SeriesCurve& curve) { return !curve.cell->runs.front()->dataset.empty(); });
  // Learners from a simulator alone have the same curves on all benchmarks that share it.
  if (!use_data) {
    const std::string world = benchmark.world.empty() ? "" : ", in " + benchmark.world;
    return fmt::format("{}{}, {} simulator, without data", benchmark.environment, world,
                       benchmark.simulator.empty() ? "true" : benchmark.simulator);
  }
  return benchmark.name + (are_shortest ? "" : ", longer runs");
}

// The shorter group first. One panel for all would squeeze the offline learners' hundred thousand
// updates into a tenth of it beside an online learner's million.
std::vector<CurveGroup> GroupByLength(const Benchmark& benchmark, std::vector<SeriesCurve> curves) {
  std::vector<CurveGroup> groups;
  while (!curves.empty()) {
    const double limit = kLongestToShortest * std::ranges::min(curves, {}, &SeriesCurve::End).End();
    CurveGroup group;
    for (SeriesCurve& curve : curves) {
      (curve.End() <= limit ? group.curves : group.longer).push_back(std::move(curve));
    }
    group.title = TitleOf(benchmark, group.curves, groups.empty());
    curves = group.longer;
    groups.push_back(std::move(group));
  }
  return groups;
}

// All groups of which no other one shows all runs too; of equal ones the first.
std::vector<CurveGroup> TellingGroups(const ScoreTable& table,
                                      const std::map<Series, size_t>& numbers) {
  std::vector<std::pair<CurveGroup, std::set<std::string>>> all;
  for (const Benchmark* benchmark : table.benchmarks()) {
    std::vector<SeriesCurve> curves;
    for (const auto& [series, number] : numbers) {
      const Cell* cell = table.Find(benchmark->name, series);
      if (cell == nullptr) continue;
      SeriesCurve curve = {number, cell, MeanCurveOf(*cell)};
      if (!curve.mean.updates.empty()) curves.push_back(std::move(curve));
    }
    for (CurveGroup& group : GroupByLength(*benchmark, std::move(curves))) {
      auto runs = group.Runs();
      all.emplace_back(std::move(group), std::move(runs));
    }
  }
  std::vector<CurveGroup> telling;
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

Panel CurvesPanel(const CurveGroup& group) {
  Panel panel;
  panel.title = group.title;
  panel.x = {.name = "updates", .unit = "thousands"};
  const bool has_returns = group.curves.front().cell->runs.front()->is_return;
  panel.y = {.name = has_returns ? kReturn : "score", .unit = ""};
  const double end = std::ranges::max(group.curves, {}, &SeriesCurve::End).End();
  for (const SeriesCurve& curve : group.longer) {
    const double score = curve.cell->Mean();
    panel.marks.emplace_back(Line{curve.number, true, {0, end}, {score, score}});
  }
  for (const SeriesCurve& curve : group.curves) {
    const MeanCurve& mean = curve.mean;
    if (curve.cell->runs.size() > 1) {
      panel.marks.emplace_back(Band{curve.number, mean.updates, mean.low, mean.high});
    }
    panel.marks.emplace_back(Line{curve.number, false, mean.updates, mean.mean});
  }
  FitX({&panel, 1});
  if (has_returns) FitY({&panel, 1});
  return panel;
}

}  // namespace

std::vector<Picture> CurvesPictures(const Evidence& evidence) {
  const auto [names, numbers] = NumberSeries(evidence);
  std::vector<Panel> panels;
  for (const CurveGroup& group : TellingGroups(evidence.table, numbers)) {
    panels.push_back(CurvesPanel(group));
  }
  // Scores have one axis, so that panels can be compared; returns have no scale in common.
  const auto returns = std::ranges::stable_partition(
      panels, [](const Panel& panel) { return panel.y.name != kReturn; });
  FitY({panels.begin(), returns.begin()});
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
  auto [names, numbers] = NumberSeries(evidence);
  figure.series = std::move(names);
  Panel panel;
  panel.x = {.name = "normalised score", .unit = ""};
  panel.y = {.name = "share of runs", .unit = ""};
  bool has_bands = false;
  for (const Aggregate& each : aggregates.series) {
    const size_t number = numbers.at(each.series);
    Band band = {number, aggregates.thresholds, {}, {}};
    for (const Interval& interval : each.profile_intervals) {
      band.low.push_back(interval.low);
      band.high.push_back(interval.high);
    }
    has_bands |= !band.low.empty();
    if (!band.low.empty()) panel.marks.emplace_back(std::move(band));
    panel.marks.emplace_back(Line{number, false, aggregates.thresholds, each.profile});
  }
  figure.sentences = {fmt::format(
      "Over {} benchmarks, of which one run may fill several and counts once{}.",
      aggregates.benchmarks.size(),
      has_bands ? fmt::format("; bands, from {} cells on, are intervals of 95%", kLeastBenchmarks)
                : std::string())};
  figure.panels = {std::move(panel)};
  FitX(figure.panels);
  FitY(figure.panels);
  return picture;
}

}  // namespace b4mrl
