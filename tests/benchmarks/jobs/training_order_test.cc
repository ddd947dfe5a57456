#include "benchmarks/jobs/training_order.h"

#include <catch2/catch.hpp>

namespace b4mrl {
namespace {

RunResult ResultAt(uint64_t updates, bool finished, bool settled) {
  RunResult result;
  result.updates = updates;
  result.finished = finished;
  result.settled = settled;
  return result;
}

TEST_CASE("A run goes on for its updates again while it has not settled, at most so often") {
  PlannedRun run;
  run.updates = 20;
  CHECK(UpdatesToTrain(run, std::nullopt, 3) == 20);
  CHECK(UpdatesToTrain(run, ResultAt(20, true, false), 0) == 20);
  CHECK(UpdatesToTrain(run, ResultAt(20, true, false), 3) == 40);
  CHECK(UpdatesToTrain(run, ResultAt(30, false, false), 3) == 40);
  CHECK(UpdatesToTrain(run, ResultAt(80, true, false), 3) == 80);
}

TEST_CASE("A run that has settled goes no further, under whichever budget it was trained") {
  PlannedRun run;
  run.updates = 20;
  CHECK(UpdatesToTrain(run, ResultAt(20, true, true), 3) == 20);
  CHECK(UpdatesToTrain(run, ResultAt(50, true, true), 3) == 20);
}

}  // namespace
}  // namespace b4mrl
