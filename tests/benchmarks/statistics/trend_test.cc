// The expected numbers are those of scipy.stats.theilslopes.
#include "benchmarks/statistics/trend.h"

#include <catch2/catch.hpp>
#include <vector>

namespace b4mrl {
namespace {

using Values = std::vector<double>;

TEST_CASE("The median slope is scipy's, and an outlier does not move it") {
  const Values x = {0, 1, 2.5, 3, 4.5, 7}, y = {1.0, 2.2, 4.1, 5.3, 6.4, 11.0};
  CHECK(MedianSlope(x, y).value() == Approx(1.425).epsilon(1e-14));
  const Values fallen = {1.0, 2.2, 4.1, -50, 6.4, 11.0};
  CHECK(MedianSlope(x, fallen).value() == Approx(1.24).epsilon(1e-14));
}

TEST_CASE("Points above one another have no slope") {
  CHECK_FALSE(MedianSlope(Values{}, Values{}));
  CHECK_FALSE(MedianSlope(Values{1}, Values{2}));
  CHECK_FALSE(MedianSlope(Values{1, 1}, Values{2, 3}));
  CHECK(MedianSlope(Values{1, 1, 2}, Values{2, 2, 5}).value() == 3);
}

}  // namespace
}  // namespace b4mrl
