#include "algorithms/pictures/axis.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <set>
#include <string>
#include <vector>

namespace b4mrl {
namespace {

std::vector<std::string> Labels(double low, double high, size_t most, bool whole = false) {
  std::vector<std::string> labels;
  for (const Tick& tick : Ticks({"", "", low, high, whole}, most)) labels.push_back(tick.label);
  return labels;
}
using Words = std::vector<std::string>;

TEST_CASE("Ticks are round numbers within the axis, its ends included") {
  CHECK(Labels(-1, 1, 5) == Words{"-1.0", "-0.5", "0", "0.5", "1.0"});
  CHECK(Labels(0, 0.3, 4) == Words{"0", "0.1", "0.2", "0.3"});
  CHECK(Labels(138.8, 5111.3, 7) == Words{"1,000", "2,000", "3,000", "4,000", "5,000"});
  CHECK(Labels(0.03, 0.19, 5) == Words{"0.05", "0.10", "0.15"});
  CHECK(Labels(0, 3e6, 4) == Words{"0", "1e6", "2e6", "3e6"});
  CHECK(Labels(-2.5e-7, 0, 6) == Words{"-2.5e-7", "-2e-7", "-1.5e-7", "-1e-7", "-5e-8", "0"});
}

TEST_CASE("An axis of counts has no fractions") {
  CHECK(Labels(0, 1.2, 7, true) == Words{"0", "1"});
  CHECK(Labels(0, 1.2, 7, false) == Words{"0", "0.2", "0.4", "0.6", "0.8", "1.0", "1.2"});
}

TEST_CASE("Ticks of any range are distinct, ascending and not too many") {
  for (const double centre : {0.0, 1.0, -12345.678, 1e-30, -1e30}) {
    for (const double width : {2e-6, 0.001, 0.7, 3.0, 1e9}) {
      const double scale = centre == 0 ? 1 : std::abs(centre);
      const double low = centre - width * scale, high = centre + width * scale;
      for (size_t most = 1; most <= 7; ++most) {
        CAPTURE(low, high, most);
        const std::vector<Tick> ticks = Ticks({"", "", low, high}, most);
        CHECK(ticks.size() <= most);
        std::set<std::string> labels;
        for (size_t i = 0; i < ticks.size(); ++i) {
          // A tick on the end of an axis may be off by the rounding of its multiplication.
          CHECK(ticks[i].value >= low - 1e-9 * (high - low));
          CHECK(ticks[i].value <= high + 1e-9 * (high - low));
          if (i > 0) CHECK(ticks[i].value > ticks[i - 1].value);
          labels.insert(ticks[i].label);
        }
        CHECK(labels.size() == ticks.size());
      }
    }
  }
}

TEST_CASE("Round steps are 1, 2 or 5 times a power of ten") {
  CHECK(RoundStep(1) == 1);
  CHECK(RoundStep(1.1) == 2);
  CHECK(RoundStep(2.1) == 5);
  CHECK(RoundStep(5.1) == 10);
  CHECK(RoundStep(0.03) == Approx(0.05).epsilon(1e-12));  // of two roundings
  CHECK(RoundStep(1000) == 1000);
}

TEST_CASE("Equal numbers get an axis around them, others keep their bounds") {
  const AxisRange zero = AxisRange::Around(0, 0);
  CHECK(zero.low < 0);
  CHECK(zero.high > 0);
  const AxisRange large = AxisRange::Around(-1e12, -1e12);
  CHECK(large.low < -1e12);
  CHECK(large.high > -1e12);
  const AxisRange other = AxisRange::Around(2, 3);
  CHECK(other.low == 2);
  CHECK(other.high == 3);
}

TEST_CASE("An axis without a unit has its name alone as title") {
  CHECK(Axis{"speed", "m/s"}.Title() == "speed (m/s)");
  CHECK(Axis{"score", ""}.Title() == "score");
}

}  // namespace
}  // namespace b4mrl
