#include "benchmarks/jobs/training_order.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cstdlib>
#include <string>

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

TEST_CASE("A user's learner has one thread in its libraries unless its user says otherwise") {
  PlannedRun run;
  run.learner = "true";
  run.benchmarks = {"HalfCheetah/clean/medium"};
  unsetenv("OPENBLAS_NUM_THREADS");
  setenv("OMP_NUM_THREADS", "3", 1);
  const auto variables = LearnerOrder(run, "runs/mine", {}).environment;
  unsetenv("OMP_NUM_THREADS");
  CHECK(std::ranges::count(variables, "OPENBLAS_NUM_THREADS=1") == 1);
  // The process that is started inherits the user's own.
  CHECK(std::ranges::none_of(
      variables, [](const std::string& each) { return each.starts_with("OMP_NUM_THREADS="); }));
}

}  // namespace
}  // namespace b4mrl
