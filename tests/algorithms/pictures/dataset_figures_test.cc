#include "algorithms/pictures/dataset_figures.h"

#include <fmt/format.h>

#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "tests/algorithms/pictures/svg_document.h"

namespace b4mrl {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

// Episodes of 10 rows; observation i of row r is r + i, actions are in [-1, 1].
struct Data {
  Data(size_t rows, size_t observation_size, size_t action_size)
      : terminals(rows), timeouts(rows), size(observation_size), actions_size(action_size) {
    for (size_t row = 0; row < rows; ++row) {
      for (size_t i = 0; i < size; ++i) observations.push_back(static_cast<float>(row + i));
      for (size_t i = 0; i < action_size; ++i) {
        actions.push_back(std::sin(static_cast<float>(row + i)));
      }
      rewards.push_back(static_cast<float>(row));
      terminals[row] = row % 10 == 9;
    }
  }
  void Set(size_t dimension, float value) {
    for (size_t at = dimension; at < observations.size(); at += size) observations[at] = value;
  }
  RowBlock Block() const { return {observations, actions, rewards, terminals, timeouts}; }
  DatasetTally Tally(const Data* other = nullptr) const {
    DatasetTally tally(size, actions_size), beside(size, actions_size);
    tally.Measure(Block());
    if (other != nullptr) beside.Measure(other->Block());
    tally.PrepareBins(other != nullptr ? &beside : nullptr);
    tally.Count(Block());
    return tally;
  }

  std::vector<float> observations, actions, rewards;
  std::vector<uint8_t> terminals, timeouts;
  size_t size, actions_size;
};

EnvironmentSpec Runner(size_t observation_size) {
  EnvironmentSpec spec;
  for (size_t i = 0; i < observation_size; ++i) {
    spec.observation.dimensions.push_back({.name = fmt::format("joint{}", i), .unit = "rad"});
  }
  spec.action.dimensions = {{.name = "thigh", .unit = ""}};
  spec.reference_min = -100;
  spec.reference_max = 900;
  return spec;
}

TEST_CASE("Returns have their mean, and the normalised score as a second axis") {
  const DatasetTally tally = Data(45, 2, 1).Tally();
  const SvgDocument svg(RenderSvg(ReturnsFigure({"Runner/a", "", Runner(2), {}}, tally)));
  // The sums of 0 to 9, 10 to 19, 20 to 29 and 30 to 39; their mean is 195.
  CHECK(svg.title() == "Runner/a: returns of 4 complete episodes");
  CHECK(svg.Says("The last episode is not complete and left out."));
  CHECK(svg.Says("The returns lie between 45 and 345."));
  CHECK(svg.Says("mean 195, normalised score 29.5"));
  CHECK(svg.Says("episode return (sum of rewards)"));
  CHECK(svg.Says("normalised score (0: return -100, 100: return 900)"));
  svg.CheckThatTextsAreApart();
  const SvgDocument unknown(RenderSvg(ReturnsFigure({"Mine/a", "", std::nullopt, {}}, tally)));
  CHECK(unknown.Says("mean 195"));
}

TEST_CASE("No episode, one episode and returns that are not finite are said and drawn") {
  const Figure none = ReturnsFigure({"A/b", "", {}, {}}, Data(5, 1, 1).Tally());
  CHECK(none.title == "A/b: returns of 0 complete episodes");
  CHECK(none.panels.empty());
  const Figure empty = ReturnsFigure({"A/b", "", {}, {}}, Data(0, 1, 1).Tally());
  CHECK(empty.sentences.empty());
  const SvgDocument one(RenderSvg(ReturnsFigure({"A/b", "", {}, {}}, Data(10, 1, 1).Tally())));
  CHECK(one.title() == "A/b: returns of 1 complete episode");
  CHECK(one.Says("mean 45"));
  CHECK(one.Count("path", "series0") == 1);
  Data spoilt(30, 1, 1);
  spoilt.rewards[3] = kNaN;
  spoilt.rewards[15] = -INFINITY;
  const SvgDocument said(RenderSvg(ReturnsFigure({"A/b", "", {}, {}}, spoilt.Tally())));
  CHECK(said.Says("Returns that are not drawn: 1 NaN, 1 infinite."));
  CHECK(said.Says("mean 245"));
}

TEST_CASE("Dimensions have the environment's names and units, if it is that of the data") {
  const DatasetTally tally = Data(100, 3, 1).Tally();
  const std::vector<Figure> figures =
      ObservationFigures({"Runner/a", "", Runner(3), {}}, tally, nullptr);
  REQUIRE(figures.size() == 1);
  const SvgDocument svg(RenderSvg(figures[0]));
  CHECK(svg.Says("observation 2: joint2"));
  CHECK(svg.Says("joint2 (rad)"));
  CHECK(svg.Count("path", "series0") == 3);
  const SvgDocument action(RenderSvg(ActionFigures({"Runner/a", "", Runner(3), {}}, tally).at(0)));
  CHECK(action.Says("thigh (no unit)"));
  const SvgDocument other(
      RenderSvg(ObservationFigures({"Runner/a", "", Runner(4), {}}, tally, nullptr).at(0)));
  CHECK(other.Says("observation 2"));
  CHECK(other.Says("value (unit unknown)"));
}

TEST_CASE("Clean and corrupted values stand in one panel, what is constant in words") {
  Data clean(100, 5, 1), corrupted(100, 5, 1);
  corrupted.Set(1, 0);                   // hidden
  clean.Set(2, 1), corrupted.Set(2, 1);  // the same in both
  clean.observations[3] = kNaN, corrupted.observations[3] = kNaN;
  corrupted.Set(4, kNaN);
  const DatasetTally before = clean.Tally(&corrupted), after = corrupted.Tally(&clean);
  const std::vector<Figure> figures =
      ObservationFigures({"Runner/a", "hidden=1", {}, {1}}, after, &before);
  REQUIRE(figures.size() == 1);
  const std::vector<Panel>& panels = figures[0].panels;
  REQUIRE(panels.size() == 5);
  CHECK(panels[0].notes.empty());
  CHECK(panels[0].marks.size() == 2);
  CHECK(panels[1].notes == std::vector<std::string>{"corrupted: hidden: always 0"});
  CHECK(panels[1].marks.size() == 1);
  CHECK(panels[2].notes == std::vector<std::string>{"always 1"});
  CHECK(panels[2].marks.empty());
  CHECK(panels[3].notes == std::vector<std::string>{"1 NaN"});
  CHECK(panels[4].notes == std::vector<std::string>{"corrupted: 100 NaN"});
  const SvgDocument svg(RenderSvg(figures[0]));
  CHECK(svg.Says("clean"));
  CHECK(svg.Says("Corrupted by hidden=1."));
  svg.CheckThatTextsAreApart();
}

TEST_CASE("What the behaviour policy could not see is said of clean data, too") {
  Data data(100, 2, 1);
  data.Set(0, 0);
  const auto figures = ObservationFigures({"Runner/a", "", {}, {0}}, data.Tally(), nullptr);
  CHECK(figures.at(0).panels.at(0).notes == std::vector<std::string>{"hidden: always 0"});
}

TEST_CASE("Many dimensions continue in further figures, and each is drawn once") {
  const DatasetTally tally = Data(20, 376, 17).Tally();
  const std::vector<Figure> figures =
      ObservationFigures({"Runner/a", "", Runner(376), {}}, tally, nullptr);
  REQUIRE(figures.size() == 8);
  CHECK(figures.front().title == "Runner/a: observations 0 to 47 of 376");
  CHECK(figures.back().title == "Runner/a: observations 336 to 375 of 376");
  size_t number = 0;
  for (const Figure& figure : figures) {
    for (const Panel& panel : figure.panels) {
      CHECK(panel.title == fmt::format("observation {0}: joint{0}", number));
      ++number;
    }
    SvgDocument(RenderSvg(figure)).CheckThatTextsAreApart();
  }
  CHECK(number == 376);
  CHECK(ActionFigures({"Runner/a", "", Runner(376), {}}, tally).size() == 1);
}

TEST_CASE("A dataset without rows says so in each panel") {
  const auto figures = ObservationFigures({"A/b", "", {}, {}}, Data(0, 2, 1).Tally(), nullptr);
  CHECK(figures.at(0).panels.at(1).notes == std::vector<std::string>{"no rows"});
  CHECK(figures.at(0).panels.at(1).marks.empty());
}

}  // namespace
}  // namespace b4mrl
