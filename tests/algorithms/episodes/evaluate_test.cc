// Evaluations at a real daemon.
#include "algorithms/episodes/evaluate.h"

#include "algorithms/experience/training_simulator.h"
#include "tests/algorithms/fixtures.h"

namespace b4mrl {

TEST_CASE("The largest seed there is evaluates and trains in as many lanes as any other") {
  TestDaemon daemon;
  RequireOk(
      Evaluator::Open(daemon.client(), "HalfCheetah", {}, /*episodes=*/10, UINT64_MAX).status());
  LearnerContext context;
  context.client = &daemon.client();
  context.environment = Take(daemon.client().FindEnvironment("HalfCheetah"));
  context.seed = UINT64_MAX;
  RequireOk(OpenTrainingSimulator(context, /*lanes=*/8).status());
}

}  // namespace b4mrl
