// H2O's turns in the simulator, against a real daemon.
#include <algorithm>
#include <catch2/catch.hpp>
#include <string>
#include <vector>

#include "algorithms/learners/learners.h"
#include "algorithms/rl/batch_buffer.h"
#include "tests/algorithms/learners/fixtures.h"

namespace b4mrl {
namespace {

LearnerContext ContextOf(TestDaemon& daemon) {
  LearnerContext context = CheetahContext(daemon, "HalfCheetah/small");
  context.simulator = {{"gravity", ""}};
  context.seed = 7;
  context.folder = daemon.folder("");
  context.hyperparameters = Hyperparameters(H2oHyperparameters());
  RequireOk(context.hyperparameters.Set("hidden-width", 8));
  RequireOk(context.hyperparameters.Set("steps-per-cycle", 30));
  RequireOk(context.hyperparameters.Set("updates-per-cycle", 5));
  return context;
}

// Trains and returns the number of simulator steps after each update.
std::vector<uint64_t> StepsAfterUpdates(Learner& learner, int updates) {
  Progress quiet(true);
  RequireOk(learner.Prepare(quiet));
  std::vector<uint64_t> steps;
  for (int i = 0; i < updates; ++i) {
    MetricMeans metrics;
    RequireOk(learner.Update(metrics));
    CHECK_FALSE(metrics.first_nonfinite());
    steps.push_back(learner.environment_steps());
  }
  return steps;
}

}  // namespace

TEST_CASE("H2O goes into the simulator before the first update of each cycle") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 300);
  const LearnerContext context = ContextOf(daemon);
  const auto learner = Take(CreateH2o(context));
  CHECK(StepsAfterUpdates(*learner, 7) == std::vector<uint64_t>{30, 30, 30, 30, 30, 60, 60});
}

TEST_CASE("H2O's policy sees what its dataset shows, whatever the simulator would") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 300);
  LearnerContext context = ContextOf(daemon);
  context.corruption = {{"hidden", "9"}};
  const auto learner = Take(CreateH2o(context));
  StepsAfterUpdates(*learner, 1);
  std::vector<float> expected(17, 1.0f);
  expected[9] = 0;
  CHECK(learner->Policy().observation_mask == expected);
}

TEST_CASE("Actions beyond the bounds are clipped in the columns asked for, and there alone") {
  BatchBuffer batch(1, 2, 3);
  std::ranges::fill(batch.actions.values(), -1.5f);
  batch.actions.view()(1, 0) = 0.5f;
  batch.ClipActions(2);
  CHECK(batch.actions.view()(0, 0) == -1);
  CHECK(batch.actions.view()(1, 0) == 0.5f);
  CHECK(batch.actions.view()(1, 1) == -1);
  CHECK(batch.actions.view()(0, 2) == -1.5f);
}

TEST_CASE("H2O refuses batches of real or of simulated rows alone") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 50);
  LearnerContext context = ContextOf(daemon);
  for (const double ratio : {0.0, 1.0}) {
    RequireOk(context.hyperparameters.Set("real-ratio", ratio));
    const Status status = CreateH2o(context).status();
    CHECK(status.code() == StatusCode::kInvalidArgument);
    CHECK(status.message().find("real-ratio") != std::string::npos);
  }
}

}  // namespace b4mrl
