#include "algorithms/pictures/tick_labels.h"

#include <catch2/catch.hpp>

namespace b4mrl {
namespace {

using Names = std::vector<std::string>;

TEST_CASE("Short names stand below their places, longer ones in several lines") {
  const Axis axis = Axis::OfPlaces("", {"bc", "medium and gravity"});
  const TickLabels wide = LabelsBelow(axis, 600), narrow = LabelsBelow(axis, 160);
  REQUIRE(wide.labels.size() == 2);
  CHECK(wide.labels[1].lines == Names{"medium and gravity"});
  CHECK(wide.labels[1].value == 1);
  CHECK_FALSE(narrow.upwards);
  CHECK(narrow.labels[1].lines == Names{"medium and", "gravity"});
  CHECK(narrow.extent == wide.extent + kTickLineHeight);
}

TEST_CASE("Names with a word that is too long are turned") {
  const TickLabels labels =
      LabelsBelow(Axis::OfPlaces("", {"bc", "medium-expert+hidden-high-history=4"}), 160);
  CHECK(labels.upwards);
  REQUIRE(labels.labels.size() == 2);
  CHECK(labels.labels[1].lines == Names{"medium-expert+hidden-high-history=4"});
}

TEST_CASE("Names without room are left out at equal distances") {
  const TickLabels labels = LabelsBelow(Axis::OfPlaces("", Names(40, "a name")), 240);
  CHECK(labels.upwards);
  REQUIRE(labels.labels.size() == 20);
  CHECK(labels.labels[19].value == 38);
}

TEST_CASE("Names beside a plot have at most the width that is given, and a plot high enough") {
  const Axis axis = Axis::OfPlaces("", {"bc", "medium and gravity", "medium"});
  CHECK(LabelsBeside(axis, 10, 400).labels[1].lines.size() == 1);
  const TickLabels labels = LabelsBeside(axis, 10, 70);
  REQUIRE(labels.labels.size() == 3);
  CHECK(labels.labels[1].lines == Names{"medium and", "gravity"});
  CHECK(labels.extent <= 70);
  CHECK(LeastHeight(axis, 70) >= 3 * 2 * kTickLineHeight);
  CHECK(LeastHeight(axis, 400) < LeastHeight(axis, 70));
  CHECK(LeastHeight({"speed", "m/s", 0, 1}, 70) == 0);
}

}  // namespace
}  // namespace b4mrl
