#include "algorithms/pictures/marks.h"

#include <catch2/catch.hpp>
#include <set>
#include <string>
#include <vector>

#include "tests/algorithms/pictures/svg_document.h"

namespace b4mrl {
namespace {

// What is drawn on a plot from (100, 200) to (200, 300) with values from 0 to 10 on both axes,
// where numbers are given; y grows upwards.
class Drawing {
 public:
  explicit Drawing(const Mark& mark, bool x_is_named = false, bool y_is_named = false) {
    Panel panel;
    const std::vector<std::string> ten(10, "a place");
    if (x_is_named) panel.x = Axis::OfPlaces("", ten);
    if (y_is_named) panel.y = Axis::OfPlaces("", ten);
    SvgWriter svg;
    const Scale down{0, 10, 200, 300}, up{0, 10, 300, 200};
    DrawMark({panel, 100, 200, 200, 300, {0, 10, 100, 200}, y_is_named ? down : up, &svg}, mark);
    document_.emplace(svg.Finish(300, 400, "", ""));
  }

  // The paths of this class, in the order in which they were drawn.
  std::vector<std::string> Paths(const std::string& css_class) const {
    std::vector<std::string> paths;
    for (const auto* path = document_->root().FirstChildElement("path"); path != nullptr;
         path = path->NextSiblingElement("path")) {
      if (path->Attribute("class", css_class.c_str())) paths.push_back(path->Attribute("d"));
    }
    return paths;
  }
  const SvgDocument& document() const { return *document_; }

 private:
  std::optional<SvgDocument> document_;
};

using Paths = std::vector<std::string>;

TEST_CASE("Upright bars go from 0 to their value around their place, with whiskers") {
  const Drawing drawing(
      Bars{3, 1, {{2, 5, AxisRange{4, 6}}, {.at = 7, .value = 1, .open = true, .hint = "1 < 2"}}},
      true);
  CHECK(drawing.Paths("bar series3") == Paths{"M115 300L115 250L125 250L125 300Z"});
  CHECK(drawing.Paths("series3") == Paths{"M165 300L165 290L175 290L175 300Z"});
  CHECK(drawing.Paths("whisker series3") == Paths{"M117 260H123M117 240H123M120 260V240"});
}

TEST_CASE("Bars lie where the places are beside the plot, the first place at the top") {
  const Drawing drawing(Bars{0, 1, {{2, 5, AxisRange{4, 6}}}}, false, true);
  CHECK(drawing.Paths("bar series0") == Paths{"M100 215L150 215L150 225L100 225Z"});
  CHECK(drawing.Paths("whisker series0") == Paths{"M140 217V223M160 217V223M140 220H160"});
}

TEST_CASE("Points have whiskers along the axes that have intervals, and stand over them") {
  const Drawing drawing(Dots{1,
                             {{.x = 2, .y = 5, .x_interval = AxisRange{1, 4}},
                              {.x = 3, .y = 5, .y_interval = AxisRange{5, 9}, .open = true},
                              {.x = 4, .y = 5}}});
  CHECK(drawing.Paths("whisker series1") ==
        Paths{"M110 247V253M140 247V253M110 250H140", "M127 250H133M127 210H133M130 250V210"});
  CHECK(drawing.Paths("dot series1") ==
        Paths{SymbolPath(1, {120, 250}), SymbolPath(1, {140, 250})});
  CHECK(drawing.Paths("open series1") == Paths{SymbolPath(1, {130, 250})});
}

TEST_CASE("Lines and bands go through their values") {
  CHECK(Drawing(Line{2, false, {0, 1, 10}, {0, 10, 5}}).Paths("curve series2") ==
        Paths{"M100 300L110 200L200 250"});
  CHECK(Drawing(Line{2, true, {0, 1}, {0, 10}}).Paths("dashed curve series2").size() == 1);
  CHECK(Drawing(Line{{}, true, {0, 10}, {0, 10}}).Paths("dashed frame") ==
        Paths{"M100 300L200 200"});
  CHECK(Drawing(Band{4, {0, 10}, {1, 2}, {3, 4}}).Paths("band series4") ==
        Paths{"M100 270L200 260L200 280L100 290Z"});
}

TEST_CASE("A rule stands and a level lies; a rule without a name has no text") {
  const auto ends_of = [](const Drawing& drawing) {
    const auto* line = drawing.document().root().FirstChildElement("line");
    REQUIRE(line != nullptr);
    std::vector<double> ends;
    for (const char* end : {"x1", "y1", "x2", "y2"}) ends.push_back(line->DoubleAttribute(end));
    return ends;
  };
  CHECK(ends_of(Drawing(Rule{5, "half"})) == std::vector<double>{150, 200, 150, 300});
  CHECK(Drawing(Rule{5, "half"}).document().Says("half"));
  CHECK(Drawing(Rule{5, ""}).document().Texts().empty());
  CHECK(ends_of(Drawing(Level{5})) == std::vector<double>{100, 250, 200, 250});
}

TEST_CASE("Hints are texts of their shapes, whatever characters they have") {
  const Drawing drawing(Dots{0, {{.x = 1, .y = 1, .hint = "score < 5 & n = 3"}, {.x = 2, .y = 2}}});
  const auto* path = drawing.document().root().FirstChildElement("path");
  REQUIRE(path->FirstChildElement("title") != nullptr);
  CHECK(path->FirstChildElement("title")->GetText() == std::string("score < 5 & n = 3"));
  CHECK(path->NextSiblingElement("path")->NoChildren());
}

TEST_CASE("Ten series have ten colours, and ninety differ in colour or symbol") {
  std::set<std::string> colours, looks;
  for (size_t i = 0; i < 90; ++i) {
    if (i < 10) colours.insert(SeriesClass(i));
    looks.insert(SeriesClass(i) + SymbolPath(i, {0, 0}));
  }
  CHECK(colours.size() == 10);
  CHECK(looks.size() == 90);
}

TEST_CASE("Things that share a place stand side by side around it") {
  CHECK(Dodge(0, 1) == 0);
  CHECK(Dodge(0, 2) == Approx(-0.2));
  CHECK(Dodge(1, 2) == Approx(0.2));
  // The outer edges of eight bars of equal widths are those of one bar.
  CHECK(Dodge(0, 8) - 0.05 == Approx(-0.4));
  CHECK(Dodge(7, 8) + 0.05 == Approx(0.4));
}

TEST_CASE("Curves of a colour that is taken again are dotted") {
  std::set<std::string> classes;
  for (size_t i = 0; i < 2 * kSeriesColours; ++i) {
    for (const bool dashed : {false, true}) classes.insert(CurveClass(i, dashed));
  }
  CHECK(classes.size() == 4 * kSeriesColours);
  CHECK(CurveClass(0, false) == "curve series0");
  CHECK(CurveClass(kSeriesColours, true) == "dashed dotted curve series0");
}

}  // namespace
}  // namespace b4mrl
