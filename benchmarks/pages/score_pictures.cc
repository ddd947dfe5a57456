// Figures of scores: hybrid gain, and those that the paper has.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <set>
#include <span>
#include <utility>

#include "algorithms/pictures/fit.h"
#include "benchmarks/pages/entries.h"
#include "benchmarks/pages/figures.h"

namespace b4mrl {
namespace {

constexpr const char* kLevels[] = {"random", "medium", "medium-replay", "medium-expert"};
constexpr double kBarShare = 0.85;  // of the distance between two places

// In the order of the observation, with the paper's words where it names a dimension.
constexpr const char* kDimensions[] = {"0 rootz (pos-root-z)",
                                       "1 rooty",
                                       "2 bthigh",
                                       "3 bshin",
                                       "4 bfoot",
                                       "5 fthigh",
                                       "6 fshin",
                                       "7 ffoot",
                                       "8 v-root-x",
                                       "9 v-root-z (h high)",
                                       "10 v-rooty",
                                       "11 v-bthigh",
                                       "12 v-bshin",
                                       "13 v-bfoot",
                                       "14 v-fthigh",
                                       "15 v-fshin",
                                       "16 v-ffoot (h low)"};

std::optional<AxisRange> WhiskerOf(const CellScore& score) {
  const auto interval = score.Interval95();
  if (!interval) return std::nullopt;
  return AxisRange{interval->low, interval->high};
}

std::string HintOf(const std::string& benchmark, const std::string& algorithm,
                   const CellScore& score) {
  return fmt::format("{}, {}: {}", benchmark, DisplayName(algorithm), ScoreEntry(score));
}

// "medium, hidden-high in the data"; the simulator's error is left out beside one of the data.
std::string PlaceOf(const Benchmark& benchmark) {
  const std::string what = benchmark.corruption.empty()
                               ? fmt::format("{} in the simulator", benchmark.simulator)
                               : fmt::format("{} in the data", benchmark.corruption);
  const std::string place = fmt::format("{}, {}", LevelOf(benchmark), what);
  return benchmark.environment == "HalfCheetah"
             ? place
             : fmt::format("{}: {}", benchmark.environment, place);
}

constexpr const char* kWhiskers =
    "Whiskers: intervals of 95%, which with fewer than three seeds are borrowed from other cells "
    "(* in the table of all cells).";

Axis ScoreAxis() { return {.name = "normalised score", .unit = ""}; }

// All algorithms on benchmarks that differ in their dataset; `pattern` holds {}.
Panel BarsPanel(const std::string& title, const std::string& pattern, const CellScores& scores,
                const std::vector<std::string>& algorithms) {
  Panel panel;
  panel.title = title;
  panel.x = Axis::OfPlaces("", {std::begin(kLevels), std::end(kLevels)});
  panel.y = ScoreAxis();
  for (size_t i = 0; i < algorithms.size(); ++i) {
    Bars bars = {
        .series = i, .width = kBarShare / static_cast<double>(algorithms.size()), .bars = {}};
    for (size_t level = 0; level < std::size(kLevels); ++level) {
      const std::string name = fmt::format(fmt::runtime(pattern), kLevels[level]);
      const CellScore* score = Find(scores, name, algorithms[i]);
      if (score == nullptr) continue;
      bars.bars.push_back(
          {.at = static_cast<double>(level) + Dodge(i, algorithms.size(), kBarShare),
           .value = score->mean,
           .interval = WhiskerOf(*score),
           .open = !score->settled,
           .hint = HintOf(name, algorithms[i], *score)});
    }
    if (!bars.bars.empty()) panel.marks.emplace_back(std::move(bars));
  }
  return panel;
}

// The three conditions of fig:conf_line_plots for a flaw.
std::array<std::string, 3> ConditionsOf(const std::string& flaw, const std::string& level) {
  return {fmt::format("HalfCheetah/modelling-error/gravity+{}", level),
          fmt::format("HalfCheetah/partial-observability-simulator/{}+{}", flaw, level),
          fmt::format("HalfCheetah/confounding/{}+{}", flaw, level)};
}

// Of one algorithm's scores, which a figure compares with each other: the updates that all have.
uint64_t SharedUpdates(const CellScores& scores, const std::string& algorithm,
                       std::span<const std::string> benchmarks) {
  uint64_t least = UINT64_MAX;
  for (const std::string& benchmark : benchmarks) {
    const CellScore* score = Find(scores, benchmark, algorithm);
    if (score != nullptr) least = std::min(least, score->updates);
  }
  return least;
}

struct HybridLine {
  std::string algorithm, level;
};

// The paper's hybrids and users' own, on three datasets each.
std::vector<HybridLine> HybridLines(const Evidence& evidence) {
  std::vector<std::string> hybrids;
  for (const CellScores* scores : {&evidence.paper, &evidence.ours}) {
    for (const HybridGain& gain : HybridGains(*scores, evidence.benchmarks)) {
      if (std::ranges::count(hybrids, gain.algorithm) == 0) hybrids.push_back(gain.algorithm);
    }
  }
  std::vector<HybridLine> lines;
  for (const std::string& hybrid : hybrids) {
    for (const char* level : {"medium", "medium-replay", "medium-expert"}) {
      lines.push_back({hybrid, level});
    }
  }
  return lines;
}

Panel ConditionsPanel(const std::string& title, const std::string& flaw,
                      const std::vector<HybridLine>& lines, const CellScores& scores) {
  Panel panel;
  panel.title = title;
  panel.x = Axis::OfPlaces("", {"gravity in the simulator", flaw + " in the simulator",
                                flaw + " in the data, gravity in the simulator"});
  panel.y = ScoreAxis();
  for (size_t i = 0; i < lines.size(); ++i) {
    const HybridLine& each = lines[i];
    Dots dots = {.series = i, .dots = {}};
    const auto conditions = ConditionsOf(flaw, each.level);
    const uint64_t updates = SharedUpdates(scores, each.algorithm, conditions);
    std::string recipe;  // of the last dot
    for (size_t place = 0; place < conditions.size(); ++place) {
      const CellScore* found = Find(scores, conditions[place], each.algorithm);
      const CellScore* score = found == nullptr ? nullptr : ScoreAt(*found, updates);
      if (score == nullptr) continue;
      const auto x = static_cast<double>(place);
      // Neighbours alone are joined: a line over a missing one would show a score that nobody has.
      // And of one recipe: else it would show what the recipe changes.
      if (!dots.dots.empty() && dots.dots.back().x == x - 1 && recipe == score->recipe) {
        panel.marks.emplace_back(Line{i, true, {x - 1, x}, {dots.dots.back().y, score->mean}});
      }
      dots.dots.push_back({.x = x,
                           .y = score->mean,
                           .open = !score->settled,
                           .hint = HintOf(conditions[place], each.algorithm, *score)});
      recipe = score->recipe;
    }
    if (!dots.dots.empty()) panel.marks.emplace_back(std::move(dots));
  }
  return panel;
}

// One algorithm without each single dimension, and with all of them.
Dots DimensionDots(size_t series, const CellScores& scores, const std::string& algorithm,
                   const std::string& ending, const std::string& clean) {
  Dots dots = {.series = series, .dots = {}};
  std::vector<std::string> benchmarks;
  for (size_t i = 0; i < std::size(kDimensions); ++i) {
    benchmarks.push_back(fmt::format("HalfCheetah/dimensions/hidden={}{}", i, ending));
  }
  benchmarks.push_back(clean);
  const uint64_t updates = SharedUpdates(scores, algorithm, benchmarks);
  const CellScore* unhidden = Find(scores, clean, algorithm);
  for (size_t place = 0; place < benchmarks.size(); ++place) {
    const CellScore* found = Find(scores, benchmarks[place], algorithm);
    if (found == nullptr) continue;
    if (unhidden != nullptr && found->recipe != unhidden->recipe) continue;
    const CellScore* score = ScoreAt(*found, updates);
    if (score == nullptr) continue;
    dots.dots.push_back({.x = score->mean,
                         .y = static_cast<double>(place) + Dodge(series, 2, 0.4),
                         .x_interval = WhiskerOf(*score),
                         .open = !score->settled,
                         .hint = HintOf(benchmarks[place], algorithm, *score)});
  }
  return dots;
}

}  // namespace

std::vector<std::string> AlgorithmsOf(const Evidence& evidence) {
  std::set<std::string> algorithms;
  for (const CellScores* scores : {&evidence.paper, &evidence.ours}) {
    for (const auto& [name, score] : *scores) algorithms.insert(name.second);
  }
  std::vector<std::string> ordered(algorithms.begin(), algorithms.end());
  std::ranges::stable_sort(ordered, {}, OrderOf);
  return ordered;
}

std::vector<std::string> SeriesNames(const std::vector<std::string>& algorithms) {
  std::vector<std::string> names;
  for (const std::string& algorithm : algorithms) names.push_back(DisplayName(algorithm));
  return names;
}

Picture GainPicture(const std::vector<HybridGain>& ours, const std::vector<HybridGain>& paper,
                    const std::vector<Benchmark>& all) {
  std::vector<std::string> benchmarks, hybrids, places;
  for (const auto* gains : {&paper, &ours}) {
    for (const HybridGain& gain : *gains) {
      if (std::ranges::count(benchmarks, gain.benchmark) == 0) benchmarks.push_back(gain.benchmark);
      if (std::ranges::count(hybrids, gain.algorithm) == 0) hybrids.push_back(gain.algorithm);
    }
  }
  Picture picture;
  picture.id = "hybrid-gain";
  picture.figure.title = "Hybrid gain: a hybrid's score minus the best with one source";
  picture.figure.sentences = {
      "Right of 0, simulator and data together are worth more than either alone. With an error in "
      "the data the simulator has the gravity error.",
      "Open: a score that it rests on still moves."};
  Panel panel;
  for (const std::string& benchmark : benchmarks) {
    places.push_back(PlaceOf(*std::ranges::find(all, benchmark, &Benchmark::name)));
  }
  panel.y = Axis::OfPlaces("", places);
  panel.x = {.name = "gain", .unit = "points"};
  panel.marks.emplace_back(Rule{0, ""});
  for (const auto* gains : {&paper, &ours}) {
    for (const std::string& hybrid : hybrids) {
      const size_t series = picture.figure.series.size();
      Dots dots = {.series = series, .dots = {}};
      for (const HybridGain& gain : *gains) {
        if (gain.algorithm != hybrid) continue;
        const auto place = std::ranges::find(benchmarks, gain.benchmark) - benchmarks.begin();
        dots.dots.push_back({.x = gain.gain,
                             .y = static_cast<double>(place),
                             .open = !gain.settled,
                             .hint = fmt::format("{}: {}", gain.benchmark, Signed(gain.gain))});
      }
      if (dots.dots.empty()) continue;
      picture.figure.series.push_back(
          fmt::format("{}, {}", DisplayName(hybrid), gains == &ours ? "ours" : "paper"));
      panel.marks.emplace_back(std::move(dots));
    }
  }
  picture.figure.panels = {std::move(panel)};
  FitX(picture.figure.panels);
  return picture;
}

Picture ScoresPicture(const Evidence& evidence) {
  Picture picture;
  picture.id = "scores-by-dataset";
  Figure& figure = picture.figure;
  figure.title = "Scores by dataset";
  figure.sentences = {
      "The paper's fig:res_fig, whose choice of algorithms is not in its source: all of them.",
      "Open: the score still moves.", kWhiskers};
  const auto algorithms = AlgorithmsOf(evidence);
  figure.series = SeriesNames(algorithms);
  figure.columns = 2;
  figure.panel_width = 560;
  figure.plot_height = 240;
  const char* gravity = "HalfCheetah/modelling-error/gravity+{}";
  const char* noise = "HalfCheetah/partial-observability-simulator/obs-noise-high+{}";
  figure.panels = {
      BarsPanel("Ours, gravity in the simulator", gravity, evidence.ours, algorithms),
      BarsPanel("Ours, observation noise in the simulator", noise, evidence.ours, algorithms),
      BarsPanel("Paper, gravity in the simulator", gravity, evidence.paper, algorithms),
      BarsPanel("Paper, observation noise in the simulator", noise, evidence.paper, algorithms)};
  FitY(figure.panels);
  return picture;
}

Picture ConditionsPicture(const Evidence& evidence) {
  Picture picture;
  picture.id = "hybrids-across-challenges";
  Figure& figure = picture.figure;
  figure.title = "Hybrids, as the error moves from the simulator into the data";
  figure.sentences = {
      "The paper's fig:conf_line_plots. The runs of a line are read at the updates of the "
      "shortest. Open: the score still moves there."};
  const std::vector<HybridLine> lines = HybridLines(evidence);
  for (const HybridLine& line : lines) {
    figure.series.push_back(fmt::format("{}, {}", DisplayName(line.algorithm), line.level));
  }
  figure.columns = 2;
  figure.panel_width = 560;
  figure.plot_height = 240;
  figure.panels = {
      ConditionsPanel("Ours, noise", "obs-noise-high", lines, evidence.ours),
      ConditionsPanel("Ours, a hidden dimension", "hidden-high", lines, evidence.ours),
      ConditionsPanel("Paper, noise", "obs-noise-high", lines, evidence.paper),
      ConditionsPanel("Paper, a hidden dimension", "hidden-high", lines, evidence.paper)};
  FitY(figure.panels);
  return picture;
}

Picture DimensionsPicture(const Evidence& evidence) {
  Picture picture;
  picture.id = "hidden-dimensions";
  Figure& figure = picture.figure;
  figure.title = "One dimension hidden: from SAC in the simulator, from TD3-BC in the data";
  figure.sentences = {
      "The paper's fig:conf, of which it prints no numbers. TD3-BC learns from medium-expert; the "
      "policy that recorded it saw all dimensions.",
      "An algorithm's runs are all read at the updates of the shortest, or at their last "
      "evaluation before that. Open: the score still moves there.",
      kWhiskers};
  figure.series = {"SAC", "TD3-BC"};
  Panel panel;
  std::vector<std::string> places(std::begin(kDimensions), std::end(kDimensions));
  places.emplace_back("nothing hidden");
  panel.y = Axis::OfPlaces("hidden dimension", places);
  panel.x = ScoreAxis();
  for (Dots& dots :
       std::array{DimensionDots(0, evidence.ours, "sac", "", "HalfCheetah/clean/medium"),
                  DimensionDots(1, evidence.ours, "td3-bc", "+medium-expert",
                                "HalfCheetah/clean/medium-expert")}) {
    if (dots.dots.empty()) {
      panel.notes.push_back(fmt::format("Nothing of {} has run yet.", figure.series[dots.series]));
    } else {
      panel.marks.emplace_back(std::move(dots));
    }
  }
  figure.panels = {std::move(panel)};
  FitX(figure.panels);
  return picture;
}

Picture BesideThePaperPicture(const Evidence& evidence) {
  Picture picture;
  picture.id = "beside-the-paper";
  Figure& figure = picture.figure;
  figure.title = "Our scores over the paper's";
  figure.sentences = {"Each run once. On the line both are equal. Open: ours still moves.",
                      kWhiskers};
  const auto algorithms = AlgorithmsOf(evidence);
  figure.series = SeriesNames(algorithms);
  figure.plot_height = 480;
  Panel panel;
  panel.x = {.name = "the paper's score", .unit = ""};
  panel.y = {.name = "our score", .unit = ""};
  panel.marks.emplace_back(Line{.dashed = true, .x = {0, 100}, .y = {0, 100}});
  std::set<std::string> counted;
  for (size_t i = 0; i < algorithms.size(); ++i) {
    Dots dots = {.series = i, .dots = {}};
    for (const auto& [name, score] : evidence.ours) {
      const CellScore* paper = Find(evidence.paper, name.first, algorithms[i]);
      if (name.second != algorithms[i] || paper == nullptr || score.has_other_rows) continue;
      if (!name.first.starts_with("HalfCheetah/") || !counted.insert(score.runs).second) continue;
      dots.dots.push_back({.x = paper->mean,
                           .y = score.mean,
                           .x_interval = WhiskerOf(*paper),
                           .y_interval = WhiskerOf(score),
                           .open = !score.settled,
                           .hint = HintOf(name.first, algorithms[i], score)});
    }
    if (!dots.dots.empty()) panel.marks.emplace_back(std::move(dots));
  }
  figure.panels = {std::move(panel)};
  FitX(figure.panels);
  FitY(figure.panels);
  return picture;
}

}  // namespace b4mrl
