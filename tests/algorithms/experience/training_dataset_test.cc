// What a run sees of its dataset: noise, hidden dimensions and environment, against a real daemon.
#include "algorithms/experience/training_dataset.h"

#include <catch2/catch.hpp>
#include <memory>
#include <vector>

#include "tests/algorithms/fixtures.h"
#include "tests/algorithms/run/small_run.h"
#include "tests/data/example_dataset.h"

namespace b4mrl {
namespace {

// "HalfCheetah/<name>", recorded by a policy that could not see `hidden`.
void WriteHiding(TestDaemon& daemon, const std::string& name, std::vector<uint32_t> hidden) {
  const ExampleDataset data = Hiding(hidden, MakeExampleDataset({100, 50}, 17, 6));
  DatasetProvenance provenance;
  provenance.environment = "HalfCheetah";
  provenance.hidden_dimensions = std::move(hidden);
  std::filesystem::create_directories(daemon.folder("data/HalfCheetah"));
  RequireOk(WriteExample(daemon.folder("data/HalfCheetah/" + name + ".h5"), data, provenance));
}

std::vector<float> Observations(const LearnerContext& context) {
  const auto dataset = Take(OpenTrainingDataset(context));
  const TransitionRows rows = Take(dataset->Read(0, 150));
  return {rows.observations.begin(), rows.observations.end()};
}

TEST_CASE("A share of a batch is as many rows as its decimals say") {
  const HyperparameterTable table = {Real("real-ratio", 0.5, {0, 1}, ""),
                                     Whole("batch-size", 100, {1, 1000}, "")};
  Hyperparameters values(table);
  for (const auto& [ratio, rows] : {std::pair{0.29, 29}, std::pair{0.57, 57}, std::pair{0.05, 5},
                                    std::pair{0.999, 99}, std::pair{1.0, 100}}) {
    RequireOk(values.Set("real-ratio", ratio));
    CHECK(RealRows(values) == rows);
  }
}

TEST_CASE("Trainings of all seeds see one noise matrix, and another one with a corruption seed") {
  TestDaemon daemon;
  WriteHiding(daemon, "medium", {});
  LearnerContext context = CheetahContext(daemon, "HalfCheetah/medium");
  const std::vector<float> clean = Observations(context);
  context.corruption = {{"obs-noise-high", ""}};
  const std::vector<float> noisy = Observations(context);
  context.seed = 1;
  CHECK(Observations(context) == noisy);
  context.corruption_seed = 1;
  const std::vector<float> otherwise = Observations(context);
  CHECK(noisy != clean);
  CHECK(otherwise != noisy);
  CHECK(otherwise != clean);
}

// The mask of the policy of a small learner, prepared.
std::vector<float> MaskOf(const Algorithm& algorithm, LearnerContext context) {
  context.hyperparameters = SmallRun(algorithm.name, "").hyperparameters;
  const TemporaryFolder folder;
  context.folder = folder.path();
  const std::unique_ptr<Learner> learner = Take(algorithm.create(context));
  Progress quiet(true);
  RequireOk(learner->Prepare(quiet));
  return learner->Policy().observation_mask;
}

TEST_CASE("A policy does not see what the behaviour policy of its dataset could not see") {
  TestDaemon daemon;
  WriteHiding(daemon, "partial-high", {9});
  for (const Algorithm& algorithm : Algorithms()) {
    if (!algorithm.needs.dataset) continue;
    INFO(algorithm.name);
    LearnerContext context = CheetahContext(daemon, "HalfCheetah/partial-high");
    std::vector<float> expected(17, 1.0f);
    expected[9] = 0;
    CHECK(MaskOf(algorithm, context) == expected);
    context.corruption = {{"hidden", "16"}};
    expected[16] = 0;
    CHECK(MaskOf(algorithm, context) == expected);
  }
}

TEST_CASE("A policy without a dataset does not see what its simulator hides") {
  TestDaemon daemon;
  for (const Algorithm& algorithm : Algorithms()) {
    if (algorithm.needs.dataset) continue;
    INFO(algorithm.name);
    LearnerContext context = CheetahContext(daemon);
    context.simulator = {{"hidden", "9"}};
    std::vector<float> expected(17, 1.0f);
    expected[9] = 0;
    CHECK(MaskOf(algorithm, context) == expected);
  }
}

TEST_CASE("A run in one environment refuses data of another one of equal sizes") {
  TestDaemon daemon;
  WriteHiding(daemon, "medium", {});
  LearnerContext context = CheetahContext(daemon, "HalfCheetah/medium");
  context.environment = Take(daemon.client().FindEnvironment("Walker2d"));
  const Status refused = OpenTrainingDataset(context).status();
  CHECK(refused.code() == StatusCode::kInvalidArgument);
  CHECK_THAT(refused.message(), Catch::Contains("recorded in HalfCheetah, not in Walker2d"));
}

TEST_CASE("A run under the rule d4rl sees fewer rows") {
  TestDaemon daemon;
  WriteHiding(daemon, "medium", {});
  LearnerContext context = CheetahContext(daemon, "HalfCheetah/medium");
  context.transitions = "d4rl";
  // The first episode's last row ended by time-out; the file's last row has no row behind it.
  CHECK(Take(OpenTrainingDataset(context))->rows() == 148);
}

}  // namespace
}  // namespace b4mrl
