#include "benchmarks/records/curve.h"

#include <catch2/catch.hpp>
#include <cmath>

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

TEST_CASE("How sure the movement is depends on how much the evaluations vary") {
  CHECK(FifthsOf(CurveOf(0, 40, 41, true)).movement_error == 0);
  Curve curve = CurveOf(0, 40, 41, true);
  curve[6].score = 38;  // 38 and 40: a deviation of sqrt(2), of the mean 1
  CHECK(FifthsOf(curve).movement_error.value() == Approx(1));
  curve[9].score = 47;  // 41 and 47: of the mean 3
  CHECK(FifthsOf(curve).movement_error.value() == Approx(std::sqrt(10.0)));
  Curve sparse;  // one evaluation a fifth
  for (size_t i = 1; i < curve.size(); i += 2) sparse.push_back(curve[i]);
  CHECK(FifthsOf(sparse).Movement().has_value());
  CHECK_FALSE(FifthsOf(sparse).movement_error.has_value());
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
