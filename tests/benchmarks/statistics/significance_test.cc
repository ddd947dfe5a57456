// The expected numbers are scipy's:
//   scipy.stats.binomtest(positive, positive + negative, alternative="greater" or default).pvalue
//   2 * scipy.stats.t.sf(abs(t), degrees), scipy.stats.t.ppf(p, degrees), 2 *
//   scipy.stats.norm.sf(z) scipy.stats.t.interval(0.95, 4, numpy.mean(v), scipy.stats.sem(v))
// and statsmodels.stats.multitest.multipletests(p, method="holm")[1].
#include "benchmarks/statistics/significance.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <vector>

namespace b4mrl {
namespace {

// Sums of up to some hundred terms: 1e-12 of the value, or what is left of 1 - (1 - p) in the
// tails.
Approx Near(double value) { return Approx(value).epsilon(1e-12).margin(1e-14); }

// Of `positive` and `negative` differences that are equally likely.
double SignTestGreater(size_t positive, size_t negative) {
  return ChanceOfAtLeast(positive, std::vector<double>(positive + negative, 0.5));
}

TEST_CASE("With even chances, counts have the exact sign test's probabilities") {
  CHECK(SignTestGreater(17, 35) == Near(0.9961062818471282));
  CHECK(SignTestGreater(3, 8) == Near(0.96728515625));
  CHECK(SignTestGreater(8, 0) == Near(0.00390625));
  CHECK(SignTestGreater(5, 5) == Near(0.623046875));
}

TEST_CASE("The sign test holds at its ends: no difference, none positive, and 900 differences") {
  CHECK(SignTestGreater(0, 0) == 1);
  CHECK(SignTestGreater(0, 20) == Near(1));
  CHECK(SignTestGreater(400, 500) == Near(0.9996240265322618));
}

TEST_CASE("Events may have chances of their own") {
  CHECK(ChanceOfAtLeast(34, std::vector<double>(52, 5.0 / 7)) == Near(0.8674110705710186));
  const double chances[] = {0.5, 0.25, 1};
  CHECK(ChanceOfAtLeast(3, chances) == Near(0.125));
  CHECK(ChanceOfAtLeast(2, chances) == Near(0.625));  // 1 - 0.5 * 0.75
  CHECK(ChanceOfAtLeast(1, chances) == Near(1));
}

TEST_CASE("Student's p-values are scipy's, also for degrees of freedom between whole numbers") {
  CHECK(StudentTwoSided(12.706, 1) == Near(0.05000080235813319));
  CHECK(StudentTwoSided(-4.303, 2) == Near(0.0499925249852145));
  CHECK(StudentTwoSided(2.5, 3) == Near(0.08770664700806556));
  CHECK(StudentTwoSided(0, 4) == 1);
  CHECK(StudentTwoSided(1.96, 30) == Near(0.05934231289605049));
  CHECK(StudentTwoSided(3.1, 101) == Near(0.0025077908596832254));
  CHECK(StudentTwoSided(7, 10) == Near(3.715592281685689e-05));
  CHECK(StudentTwoSided(3.5, 2.4) == Near(0.05567931850370521));
  CHECK(StudentTwoSided(0.02, 3.99) == Near(0.9850035336128877));
  CHECK(StudentTwoSided(INFINITY, 3) == 0);
}

TEST_CASE("With very many degrees of freedom, Student's p-values are nearly the normal ones") {
  CHECK(StudentTwoSided(1.5, 9e6) == Approx(NormalTwoSided(1.5)).epsilon(1e-6));
  CHECK(StudentTwoSided(1.5, 1e14) == Approx(NormalTwoSided(1.5)).epsilon(1e-6));
  CHECK(StudentTwoSided(1.5, 1e16) == Approx(NormalTwoSided(1.5)).epsilon(1e-6));
}

TEST_CASE("Student's quantiles are scipy's") {
  CHECK(StudentQuantile(0.975, 1) == Near(12.706204736174694));
  CHECK(StudentQuantile(0.975, 2) == Near(4.302652729749462));
  CHECK(StudentQuantile(0.975, 4) == Near(2.7764451051977934));
  CHECK(StudentQuantile(0.05, 9) == Near(-1.8331129326562376));
  CHECK(StudentQuantile(0.995, 30) == Near(2.7499956535672254));
  CHECK(StudentQuantile(0.5, 7) == 0);
  CHECK(StudentQuantile(0.9, 1000) == Near(1.2823987214609247));
  // In the tail, a rounding of p = 0.9999 itself moves the quantile by 1e-12 of its size.
  CHECK(StudentQuantile(0.9999, 1) == Approx(3183.098757118502).epsilon(1e-11));
}

TEST_CASE("Normal p-values are scipy's") {
  CHECK(NormalTwoSided(1.96) == Near(0.04999579029644087));
  CHECK(NormalTwoSided(-5) == Near(5.733031437583866e-07));
  CHECK(NormalTwoSided(0) == 1);
}

TEST_CASE("Holm's adjustment never falls with a larger p-value and keeps the order of the claims") {
  const std::vector<double> adjusted =
      HolmAdjusted(std::vector<double>{0.04, 0.01, 0.03, 0.005, 0.6, 0.03});
  const std::vector<double> expected = {0.12, 0.05, 0.12, 0.03, 0.6, 0.12};
  REQUIRE(adjusted.size() == expected.size());
  for (size_t i = 0; i < expected.size(); ++i) CHECK(adjusted[i] == Near(expected[i]));
  CHECK(HolmAdjusted(std::vector<double>{0.9, 0.8}) == std::vector<double>{1, 1});
  CHECK(HolmAdjusted({}).empty());
}

}  // namespace
}  // namespace b4mrl
