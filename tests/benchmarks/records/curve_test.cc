#include "benchmarks/records/curve.h"

#include <catch2/catch.hpp>

namespace b4mrl {
namespace {

// Ten evaluations of a run: it rises to `before` and is at `last` for its last fifth.
Curve CurveOf(double first, double before, double last, bool has_scores) {
  Curve curve;
  for (uint64_t i = 1; i <= 10; ++i) {
    CurvePoint point = {.updates = 100 * i, .mean_return = i < 7 ? first : i < 9 ? before : last};
    if (has_scores) point.score = point.mean_return;
    curve.push_back(point);
  }
  return curve;
}

TEST_CASE("Scores have settled within 1.5 points, whatever the run has learnt") {
  CHECK(FifthsOf(CurveOf(0, 40, 41.5, true)).IsSettled().value());
  CHECK_FALSE(FifthsOf(CurveOf(0, 40, 41.75, true)).IsSettled().value());
  CHECK(FifthsOf(CurveOf(1, 7, 8, true)).IsSettled().value());
}

TEST_CASE("Returns have no scale and have settled within a share of what the run has learnt") {
  CHECK_FALSE(FifthsOf(CurveOf(1.75, 7.75, 9, false)).IsSettled().value());
  CHECK(FifthsOf(CurveOf(1.75, 9, 9.125, false)).IsSettled().value());
  CHECK(FifthsOf(CurveOf(-300, 4000, 4100, false)).IsSettled().value());
  CHECK_FALSE(FifthsOf(CurveOf(-300, 4000, 4200, false)).IsSettled().value());
  CHECK(FifthsOf(CurveOf(5, 5, 5, false)).IsSettled().value());
}

}  // namespace
}  // namespace b4mrl
