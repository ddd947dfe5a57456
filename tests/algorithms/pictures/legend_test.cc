#include "algorithms/pictures/legend.h"

#include <fmt/format.h>

#include <catch2/catch.hpp>

#include "tests/algorithms/pictures/svg_document.h"

namespace b4mrl {
namespace {

struct Drawn {
  double height;
  SvgDocument svg;
};

Drawn LegendOf(const Figure& figure, double width = 1000) {
  SvgWriter svg;
  const double height = DrawLegend(figure, {0, 0}, width, &svg);
  return {height, SvgDocument(svg.Finish(width, height, "", ""))};
}

Figure Of(std::vector<Mark> marks) {
  Figure figure;
  figure.series = {"one", "two"};
  figure.panels.resize(1);
  figure.panels[0].marks = std::move(marks);
  return figure;
}

TEST_CASE("A swatch shows its series as the marks do") {
  const Drawn columns = LegendOf(Of({Columns{0, true, 0, 1, {1}}, Columns{1, false, 0, 1, {1}}}));
  CHECK(columns.svg.Count("path", "area series0") == 1);
  CHECK(columns.svg.Count("path", "series0") == 1);
  CHECK(columns.svg.Count("path", "area series1") == 0);
  CHECK(columns.svg.Count("path", "series1") == 1);
  const Drawn curves = LegendOf(Of(
      {Line{0, false, {0}, {0}}, Band{0, {0}, {0}, {0}}, Line{1, true, {0}, {0}}, Dots{1, {{}}}}));
  CHECK(curves.svg.Count("path", "curve series0") == 1);
  CHECK(curves.svg.Count("path", "band series0") == 1);
  CHECK(curves.svg.Count("path", "series0") == 0);
  CHECK(curves.svg.Count("path", "dashed curve series1") == 1);
  CHECK(curves.svg.Count("path", "dot series1") == 1);
  const Drawn bars = LegendOf(Of({Bars{1, 1, {{}}}}));
  CHECK(bars.svg.Count("path", "bar series1") == 1);
}

TEST_CASE("A legend leaves out what has no mark") {
  const Drawn legend = LegendOf(Of({Bars{1, 1, {{}}}}));
  CHECK(legend.svg.Says("two"));
  CHECK_FALSE(legend.svg.Says("one"));
  CHECK(LegendOf(Of({Line{{}, true, {0, 1}, {0, 1}}})).height == 0);
}

TEST_CASE("A legend takes as many lines as its names need") {
  Figure figure = Of({Bars{0, 1, {{}}}, Bars{1, 1, {{}}}});
  for (size_t i = 0; i < 12; ++i) {
    figure.panels[0].marks.emplace_back(Bars{figure.series.size(), 1, {{}}});
    figure.series.push_back(fmt::format("algorithm number {}", i));
  }
  const Drawn wide = LegendOf(figure, 4000), narrow = LegendOf(figure, 300);
  CHECK(narrow.height > 5 * wide.height);
  narrow.svg.CheckThatTextsAreApart();
  for (const std::string& name : figure.series) CHECK(narrow.svg.Says(name));
}

TEST_CASE("There is no legend for a single series") {
  Figure figure = Of({});
  figure.series = {"one"};
  CHECK(LegendOf(figure).height == 0);
}

}  // namespace
}  // namespace b4mrl
