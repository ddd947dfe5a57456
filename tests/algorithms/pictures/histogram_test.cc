#include "algorithms/pictures/histogram.h"

#include <catch2/catch.hpp>
#include <limits>
#include <vector>

namespace b4mrl {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

TEST_CASE("A number on an edge counts on its right, the upper end in the last bin") {
  Histogram histogram(0, 4, 4);
  for (const double value : {0.0, 0.5, 1.0, 3.0, 3.999, 4.0}) histogram.Add(value);
  CHECK(histogram.counts() == std::vector<uint64_t>{2, 1, 0, 3});
}

TEST_CASE("Numbers that are not finite lie in no bin, those outside in the nearest one") {
  Histogram histogram(-1, 1, 2);
  for (const double value : {kNaN, kInfinity, -kInfinity, -5.0, 5.0, 1e300}) histogram.Add(value);
  CHECK(histogram.counts() == std::vector<uint64_t>{1, 2});
}

TEST_CASE("A range is that of the finite numbers, and counts the others by kind") {
  NumberRange range;
  CHECK_FALSE(range.varies());
  CHECK(range.low() > range.high());
  for (const double value : {kNaN, -3.0, kInfinity, 5.0, -kInfinity, 1.0}) range.Add(value);
  CHECK(range.low() == -3);
  CHECK(range.high() == 5);
  CHECK(range.mean() == 1);
  CHECK(range.varies());
  CHECK(range.finite() == 3);
  CHECK(range.nans() == 1);
  CHECK(range.infinities() == 2);
  CHECK(range.count() == 6);
}

}  // namespace
}  // namespace b4mrl
