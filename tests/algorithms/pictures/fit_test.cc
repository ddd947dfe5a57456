#include "algorithms/pictures/fit.h"

#include <catch2/catch.hpp>
#include <vector>

namespace b4mrl {
namespace {

Panel PanelWith(std::vector<Mark> marks) {
  Panel panel;
  panel.marks = std::move(marks);
  return panel;
}

TEST_CASE("Axes hold all marks with their intervals and a margin") {
  std::vector<Panel> panels = {
      PanelWith({Dots{0, {{.x = 10, .y = 5, .x_interval = AxisRange{0, 30}}}}, Rule{40, ""}}),
      PanelWith({Line{0, false, {50, 100}, {-5, 0}}, Band{0, {60}, {-45}, {55}}, Level{20}})};
  FitX(panels);
  FitY(panels);
  for (const Panel& panel : panels) {
    CHECK(panel.x.low == Approx(-4));
    CHECK(panel.x.high == Approx(104));
    CHECK(panel.y.low == Approx(-49));
    CHECK(panel.y.high == Approx(59));
  }
}

TEST_CASE("Bars and columns stand on the axis' end at 0, unless some go the other way") {
  std::vector<Panel> panels = {PanelWith({Bars{0, 1, {{0, 40, AxisRange{30, 50}}, {1, 45}}}})};
  panels[0].x = Axis::OfPlaces("", {"a", "b"});
  FitX(panels);
  FitY(panels);
  CHECK(panels[0].x.low == -0.5);
  CHECK(panels[0].x.high == 1.5);
  CHECK(panels[0].y.low == 0);
  CHECK(panels[0].y.high == Approx(52));
  panels[0].marks.push_back(Bars{1, 1, {{0, -50}}});
  FitY(panels);
  CHECK(panels[0].y.low == Approx(-54));
  panels = {PanelWith({Columns{0, true, 0, 4, {3, 8}}})};
  FitY(panels);
  CHECK(panels[0].y.low == 0);
  CHECK(panels[0].y.high == Approx(8.32));
}

TEST_CASE("Bars beside names run along x") {
  std::vector<Panel> panels = {PanelWith({Bars{0, 1, {{0, 100}, {1, -100}}}})};
  panels[0].y = Axis::OfPlaces("", {"a", "b"});
  FitX(panels);
  FitY(panels);
  CHECK(panels[0].x.low == Approx(-108));
  CHECK(panels[0].x.high == Approx(108));
  CHECK(panels[0].y.high == 1.5);
}

TEST_CASE("A single value has an axis around it, and axes without marks stay") {
  std::vector<Panel> panels = {PanelWith({Level{7}})};
  panels[0].x.high = 3;
  FitX(panels);
  FitY(panels);
  CHECK(panels[0].x.low == 0);
  CHECK(panels[0].x.high == 3);
  CHECK(panels[0].y.low < 7);
  CHECK(panels[0].y.high > 7);
}

}  // namespace
}  // namespace b4mrl
