// Learners and steps that the simulator gives up, or that nobody waits for any more.
#include <atomic>
#include <catch2/catch.hpp>
#include <filesystem>
#include <memory>
#include <utility>
#include <vector>

#include "algorithms/cores/td3_core.h"
#include "algorithms/episodes/evaluate.h"
#include "algorithms/experience/replay_collector.h"
#include "tests/algorithms/fake_episodes.h"
#include "tests/algorithms/fixtures.h"

namespace b4mrl {

TEST_CASE("A warm-up in a simulator that gives up every step comes to an end") {
  FakeDaemon daemon{EndsEveryStep(Cause::kNumericalError)};
  Client client = Take(Client::Connect(daemon.address()));
  const TemporaryFolder folder;
  LearnerContext context = FakeContext(client, folder.File(""), AlgorithmOf("td3").hyperparameters);
  RequireOk(context.hyperparameters.Set("lanes", 2));
  ReplayCollector lanes = Take(ReplayCollector::Open(context));
  RequireOk(lanes.Start());
  Progress quiet(true);
  const Status status = lanes.WarmUp(10, quiet);
  INFO(status.ToString());
  CHECK(status.code() == StatusCode::kFailedPrecondition);
  CHECK(lanes.replay().length() == 0);
}

TEST_CASE("An evaluation counts the episodes that the simulator gave up, and those alone") {
  const auto [cause, given_up] =
      GENERATE(std::pair{Cause::kCrash, 3u}, std::pair{Cause::kNumericalError, 3u},
               std::pair{Cause::kLimit, 0u});
  FakeDaemon daemon{EndsEveryStep(cause)};
  Client client = Take(Client::Connect(daemon.address()));
  Td3Options options;
  options.observation_size = kObservationSize;
  options.action_size = kActionSize;
  options.hidden = {8, 8};
  const std::vector<float> scale(kActionSize, 1.0f);
  const Agent agent = MakeAgent(Take(Td3Core<float>::Create(options)).Policy(), 1, scale);
  Evaluator evaluator = Take(Evaluator::Open(client, "Fake", {}, /*episodes=*/3));
  const EvaluationResult result = Take(evaluator.Run(Take(AgentPolicy::Create(agent))));
  CHECK(result.lengths == std::vector<uint32_t>{1, 1, 1});
  CHECK(result.given_up == given_up);
}

TEST_CASE("A run that is to end soon cuts its warm-up and its reading short") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 300);
  const std::atomic<bool> stop = true;
  LearnerContext context;
  context.client = &daemon.client();
  context.environment = Take(daemon.client().FindEnvironment("HalfCheetah"));
  context.dataset = "HalfCheetah/small";
  context.folder = daemon.folder("");
  context.stop = &stop;
  Progress quiet(true);

  context.hyperparameters = Hyperparameters(AlgorithmOf("td3").hyperparameters);
  const std::unique_ptr<Learner> online = Take(AlgorithmOf("td3").create(context));
  RequireOk(online->Prepare(quiet));
  CHECK(online->environment_steps() == 0);

  context.hyperparameters = Hyperparameters(AlgorithmOf("hymopo").hyperparameters);
  const std::unique_ptr<Learner> hybrid = Take(AlgorithmOf("hymopo").create(context));
  RequireOk(hybrid->Prepare(quiet));
  CHECK_FALSE(std::filesystem::exists(context.folder + "/ensemble.h5"));
}

}  // namespace b4mrl
