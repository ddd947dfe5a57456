// The expected numbers are those of scipy.stats.spearmanr and scipy.stats.kendalltau.
#include "benchmarks/statistics/rank_correlation.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <vector>

namespace b4mrl {
namespace {

using Values = std::vector<double>;

Approx Near(double value) { return Approx(value).epsilon(1e-14).margin(1e-15); }

TEST_CASE("Rank correlations are scipy's, ties included") {
  const Values x = {44.2, 42.3, 48.1, 42.3, 90.7, 11.0, -2.5, 42.3};
  const Values y = {45.0, 41.0, 44.0, 47.4, 86.8, 11.0, 4.0, 47.4};
  CHECK(Spearman(x, y).value() == Near(0.7117770058270331));
  CHECK(Kendall(x, y).value() == Near(0.5773502691896257));
}

TEST_CASE("Rank correlations without ties are scipy's") {
  const Values x = {3, 1, 2, 5, 4}, y = {9, 7, 6, 8, 5};
  CHECK(Spearman(x, y).value() == Near(0.1));
  CHECK(Kendall(x, y).value() == Near(0));
}

TEST_CASE("Only the order counts: a rising function leaves 1 and a falling one -1") {
  const Values x = {-1, 0.5, 2, 7};
  Values rising, falling;
  for (const double value : x) {
    rising.push_back(std::exp(value));
    falling.push_back(-value * value * value);
  }
  CHECK(Spearman(x, rising).value() == Near(1));
  CHECK(Kendall(x, rising).value() == Near(1));
  CHECK(Spearman(x, falling).value() == Near(-1));
  CHECK(Kendall(x, falling).value() == Near(-1));
}

TEST_CASE("A rank correlation is not defined for fewer than two pairs or a constant list") {
  CHECK_FALSE(Spearman(Values{}, Values{}));
  CHECK_FALSE(Kendall(Values{}, Values{}));
  CHECK_FALSE(Spearman(Values{1}, Values{2}));
  CHECK_FALSE(Kendall(Values{1}, Values{2}));
  CHECK_FALSE(Spearman(Values{1, 2, 3}, Values{4, 4, 4}));
  CHECK_FALSE(Kendall(Values{4, 4, 4}, Values{1, 2, 3}));
}

}  // namespace
}  // namespace b4mrl
