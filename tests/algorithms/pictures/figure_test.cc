#include "algorithms/pictures/figure.h"

#include <fmt/format.h>

#include <catch2/catch.hpp>
#include <set>
#include <string>

#include "algorithms/pictures/svg.h"
#include "tests/algorithms/pictures/svg_document.h"

namespace b4mrl {
namespace {

Panel OnePanel() {
  Panel panel;
  panel.title = "a title";
  panel.x = {"speed", "m/s", -1, 1};
  panel.y = {"rows", "%", 0, 10};
  panel.marks = {Columns{0, true, -1, 1, {1, 5, 10, 2}}, Rule{0.5, "mean 0.5"}};
  return panel;
}

Figure OneFigure() {
  Figure figure;
  figure.title = "A <figure> & more";
  figure.sentences = {"It shows \"speeds\"."};
  figure.panels = {OnePanel()};
  return figure;
}

TEST_CASE("A figure has its texts, axes with names and units, and its marks") {
  const SvgDocument svg(RenderSvg(OneFigure()));
  CHECK(svg.title() == "A <figure> & more");
  for (const char* words : {"A <figure> & more", "It shows \"speeds\".", "a title", "speed (m/s)",
                            "rows (%)", "mean 0.5", "-1.0", "1.0", "10"}) {
    INFO(words);
    CHECK(svg.Says(words));
  }
  CHECK(svg.Count("path", "series0") == 1);
  CHECK(svg.Count("path", "area series0") == 1);
  CHECK(svg.Count("line", "rule") == 1);
  svg.CheckThatTextsAreApart();
}

TEST_CASE("Equal figures give equal bytes, others do not") {
  const std::string first = RenderSvg(OneFigure());
  CHECK(RenderSvg(OneFigure()) == first);
  Figure other = OneFigure();
  std::get<Columns>(other.panels[0].marks[0]).heights[0] = 1.5;
  CHECK(RenderSvg(other) != first);
}

TEST_CASE("Columns stand where the axes say") {
  Figure figure = OneFigure();
  figure.panels[0].marks = {Columns{1, false, -1, 1, {10, 0}}};
  const SvgDocument svg(RenderSvg(figure));
  const auto* path = svg.root().FirstChildElement("path");
  while (path != nullptr && !path->Attribute("class", "series1")) {
    path = path->NextSiblingElement("path");
  }
  REQUIRE(path != nullptr);
  double left = 0, bottom = 0, top = 0, middle = 0, after = 0, right = 0, end = 0;
  REQUIRE(std::sscanf(path->Attribute("d"), "M%lf %lfV%lfH%lfV%lfH%lfV%lf", &left, &bottom, &top,
                      &middle, &after, &right, &end) == 7);
  CHECK(bottom - top == Approx(figure.plot_height).margin(0.011));  // two digits are written
  CHECK(after == bottom);
  CHECK(end == bottom);
  CHECK(middle - left == Approx(right - middle).margin(0.011));
  CHECK(svg.Count("path", "area series1") == 0);
}

TEST_CASE("A legend names several series, and one alone needs none") {
  Figure figure = OneFigure();
  figure.series = {"clean"};
  CHECK_FALSE(SvgDocument(RenderSvg(figure)).Says("clean"));
  figure.series = {"clean", "corrupted"};
  figure.panels[0].marks.emplace_back(Columns{1, false, -1, 1, {2, 3}});
  const SvgDocument svg(RenderSvg(figure));
  CHECK(svg.Says("clean"));
  CHECK(svg.Says("corrupted"));
  svg.CheckThatTextsAreApart();
}

TEST_CASE("Nothing overlaps or leaves the picture, however long texts and numbers are") {
  Figure figure;
  figure.title = "a very long title of a figure that goes on and on, over more than one line of it";
  figure.sentences = {std::string(300, 'M'), "and a second sentence"};
  for (int i = 0; i < 7; ++i) figure.series.push_back(fmt::format("series with number {}", i));
  figure.columns = 4;
  figure.panel_width = 240;
  figure.plot_height = 100;
  const double scales[] = {1e-38, 1e-7, 0.037, 1, 999, 123456, 7e6, 1e38};
  for (size_t i = 0; i < 27; ++i) {
    Panel panel = OnePanel();
    panel.title = fmt::format("observation {}: cinert-right-upper-arm-mass-and-more", i);
    panel.x.name = "cinert-right-upper-arm-mass-and-more-of-it";
    const double scale = scales[i % std::size(scales)];
    panel.x.low = -scale * static_cast<double>(i + 1);
    panel.x.high = scale * 1.7;
    panel.y.high = scales[(i + 3) % std::size(scales)];
    panel.marks = {
        Columns{i % figure.series.size(), true, panel.x.low, panel.x.high, {0, panel.y.high}},
        Rule{panel.x.low + 0.9 * (panel.x.high - panel.x.low), "mean -1.23457e+08"}};
    if (i % 3 == 0) panel.notes = {"corrupted: 1,000,000 NaN, 1,000,000 infinite", "hidden"};
    if (i % 5 == 0) panel.upper_x = Axis{"normalised score", "percent", -3e5, 4e5};
    if (i % 4 == 0) panel.marks.clear();
    figure.panels.push_back(panel);
  }
  SvgDocument(RenderSvg(figure)).CheckThatTextsAreApart();
}

TEST_CASE("Nothing overlaps whatever the names of places, below the plot or beside it") {
  const std::vector<std::string> words = {"medium",
                                          "medium-replay+hidden-high-history=4",
                                          "random with a name of many words that goes on and on",
                                          "",
                                          "Ω",
                                          std::string(90, 'M')};
  for (const size_t count : {1u, 2u, 5u, 17u, 52u}) {
    Figure figure;
    figure.title = "places";
    figure.columns = 2;
    figure.panel_width = 360;
    figure.plot_height = 120;
    std::vector<std::string> places;
    for (size_t i = 0; i < count; ++i) places.push_back(words[(i + count) % words.size()]);
    Panel below = OnePanel(), beside = OnePanel();
    below.x = Axis::OfPlaces("dataset", places);
    below.marks = {Level{5}};
    beside.y = Axis::OfPlaces("dataset and what is done to it, said in very many words", places);
    beside.marks = {Rule{0.5, "mean 0.5"}};
    figure.panels = {below, beside, below, OnePanel()};
    SvgDocument(RenderSvg(figure)).CheckThatTextsAreApart();
  }
}

TEST_CASE("A figure without panels, and a panel without marks, show their texts alone") {
  Figure figure = OneFigure();
  figure.panels[0].marks.clear();
  figure.panels[0].notes = {"always 0"};
  const SvgDocument text(RenderSvg(figure));
  CHECK(text.Says("always 0"));
  CHECK_FALSE(text.Says("speed (m/s)"));
  const SvgDocument drawn(RenderSvg(OneFigure()));
  CHECK(text.height() < drawn.height() - OneFigure().plot_height);
  figure.panels.clear();
  CHECK(SvgDocument(RenderSvg(figure)).Says("It shows \"speeds\"."));
}

TEST_CASE("A picture has colours for light and for dark pages") {
  const SvgDocument svg(RenderSvg(OneFigure()));
  const std::string style = svg.root().FirstChildElement("style")->GetText();
  // A page that is read in the dark is printed on white paper.
  CHECK(style.find("@media screen and (prefers-color-scheme: dark)") != std::string::npos);
  CHECK(svg.Count("rect", "paper") == 1);
  std::set<std::string> classes;
  for (size_t i = 0; i < kSeriesColours; ++i) {
    const std::string rule = "." + SeriesClass(i) + " { color: ";
    const size_t light = style.find(rule), dark = style.find(rule, light + 1);
    REQUIRE(dark != std::string::npos);
    classes.insert(style.substr(light + rule.size(), 7));
    CHECK(style.substr(light, rule.size() + 7) != style.substr(dark, rule.size() + 7));
  }
  CHECK(classes.size() == kSeriesColours);
}

}  // namespace
}  // namespace b4mrl
