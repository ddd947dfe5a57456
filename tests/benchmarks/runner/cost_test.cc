// Costs are those that were measured, where there are any.
#include "benchmarks/runner/cost.h"

#include <catch2/catch.hpp>

namespace b4mrl {
namespace {

TEST_CASE("A run costs what others of its kind have cost") {
  PlannedRun run;
  run.algorithm = "iql";
  run.environment = "HalfCheetah";
  run.precision = "fp32";
  CostModel costs;
  const double unknown = costs.SecondsOf(run, 1000);
  CHECK(unknown > 0);
  costs.Learn(run, {.updates = 100, .seconds = 10});
  costs.Learn(run, {.updates = 300, .seconds = 70});
  costs.Learn(run, {});  // a result without updates says nothing
  CHECK(costs.SecondsOf(run, 1000) == Approx(200));
  PlannedRun other = run;
  other.precision = "bf16";
  CHECK(costs.SecondsOf(other, 1000) == unknown);
  other.algorithm = "mine";
  CHECK(costs.SecondsOf(other, 1000) > 0);
}

}  // namespace
}  // namespace b4mrl
