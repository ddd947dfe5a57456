#include "benchmarks/evidence/growth.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <cstdint>

namespace b4mrl {
namespace {

// Evaluated `count` times, after every hundredth update.
Curve CurveOf(uint64_t count, double (*score)(double updates)) {
  Curve curve;
  for (uint64_t i = 1; i <= count; ++i) {
    CurvePoint point;
    point.updates = 100 * i;
    point.score = score(static_cast<double>(point.updates));
    curve.push_back(point);
  }
  return curve;
}

double FourADoubling(double updates) { return 4 * std::log2(updates); }

TEST_CASE("A score that rises by four points a doubling gains four points a doubling") {
  CHECK(GainPerDoubling(CurveOf(50, FourADoubling)).value() == Approx(4).epsilon(1e-12));
  // So many evaluations are thinned out.
  CHECK(GainPerDoubling(CurveOf(20'000, FourADoubling)).value() == Approx(4).epsilon(1e-12));
}

TEST_CASE("Only the second half of a run counts, and a single bad evaluation does not") {
  Curve curve = CurveOf(50, [](double updates) { return updates <= 2'500 ? 0.0 : 30.0; });
  curve[40].score = -20;
  CHECK(GainPerDoubling(curve).value() == 0);
}

TEST_CASE("The return counts where there is no score") {
  Curve curve = CurveOf(50, FourADoubling);
  for (CurvePoint& point : curve) {
    point.mean_return = 10 * *point.score;
    point.score.reset();
  }
  CHECK(GainPerDoubling(curve).value() == Approx(40).epsilon(1e-12));
}

TEST_CASE("A gain per doubling needs five evaluations in the second half") {
  CHECK_FALSE(GainPerDoubling(Curve()));
  CHECK_FALSE(GainPerDoubling(CurveOf(8, FourADoubling)));
  CHECK(GainPerDoubling(CurveOf(10, FourADoubling)));
}

}  // namespace
}  // namespace b4mrl
