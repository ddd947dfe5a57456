// Datasets with a NaN or an infinity, which would make every learner diverge: against a real
// daemon.
#include <catch2/catch.hpp>
#include <limits>
#include <string>

#include "algorithms/experience/training_dataset.h"
#include "algorithms/model/model_data.h"
#include "tests/algorithms/fixtures.h"
#include "tests/data/example_dataset.h"

namespace b4mrl {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr size_t kRows = 150;

// "HalfCheetah/odd", in which `spoil` changed numbers.
template <typename Spoil>
LearnerContext OddContext(TestDaemon& daemon, Spoil spoil) {
  ExampleDataset data = MakeExampleDataset({100, 50}, 17, 6);
  spoil(data);
  std::filesystem::create_directories(daemon.folder("data/HalfCheetah"));
  RequireOk(WriteExample(daemon.folder("data/HalfCheetah/odd.h5"), data, "HalfCheetah"));
  return CheetahContext(daemon, "HalfCheetah/odd");
}

// The error of the first of so many batches that all of the dataset's rows have come.
Status FirstError(const LearnerContext& context) {
  TrainingDataset dataset = Take(TrainingDataset::Open(context, 64));
  dataset.Start(0);
  for (int batch = 0; batch < 1000; ++batch) {
    if (const Status status = dataset.Next().status(); !status.ok()) return status;
  }
  return Status();
}

void RequireNamed(const Status& status, const std::string& what) {
  CHECK(status.code() == StatusCode::kDataLoss);
  CHECK_THAT(status.message(), Catch::Contains("HalfCheetah/odd") && Catch::Contains(what));
}

TEST_CASE("Every learner refuses a dataset whose observations are not finite, by their dimension") {
  TestDaemon daemon;
  LearnerContext context =
      OddContext(daemon, [](ExampleDataset& data) { data.observations[100 * 17 + 3] = kNan; });
  for (const Algorithm& algorithm : Algorithms()) {
    if (!algorithm.needs.dataset) continue;
    INFO(algorithm.name);
    context.hyperparameters = Hyperparameters(algorithm.hyperparameters);
    RequireNamed(algorithm.create(context).status(), "observation dimension 3 is nan");
  }
}

TEST_CASE("A dataset is refused whose last observation or reward is infinite") {
  TestDaemon daemon;
  SECTION("an observation, whose mean is infinite then") {
    const LearnerContext context = OddContext(
        daemon, [](ExampleDataset& data) { data.observations[kRows * 17 - 1] = kInfinity; });
    RequireNamed(OpenTrainingDataset(context).status(), "the mean of observation dimension 16");
  }
  SECTION("a reward, of which the smallest is finite") {
    const LearnerContext context =
        OddContext(daemon, [](ExampleDataset& data) { data.rewards[kRows - 1] = kInfinity; });
    RequireNamed(OpenTrainingDataset(context).status(), "a reward is inf");
  }
}

TEST_CASE("A batch with an action or a next observation that is not finite names its row") {
  TestDaemon daemon;
  SECTION("an action") {
    RequireNamed(FirstError(OddContext(
                     daemon, [](ExampleDataset& data) { data.actions[60 * 6 + 2] = -kInfinity; })),
                 "dimension 2 of the action in row 60 is -inf");
  }
  SECTION("a next observation") {
    RequireNamed(
        FirstError(OddContext(
            daemon, [](ExampleDataset& data) { data.next_observations[149 * 17 + 5] = kNan; })),
        "dimension 5 of the next observation in row 149 is nan");
  }
  SECTION("nothing of the kind") {
    RequireOk(FirstError(OddContext(daemon, [](ExampleDataset&) {})));
  }
}

TEST_CASE("A model is not trained on data whose batches will be refused, and names the row") {
  TestDaemon daemon;
  Progress quiet(true);
  const auto refusal = [&](const LearnerContext& context) {
    return ReadChanges(context, *Take(OpenTrainingDataset(context)), quiet).status();
  };
  SECTION("an action") {
    RequireNamed(refusal(OddContext(
                     daemon, [](ExampleDataset& data) { data.actions[60 * 6 + 2] = kNan; })),
                 "dimension 2 of the action in row 60 is nan");
  }
  SECTION("a next observation") {
    RequireNamed(
        refusal(OddContext(
            daemon, [](ExampleDataset& data) { data.next_observations[149 * 17 + 5] = kNan; })),
        "dimension 5 of the next observation in row 149 is nan");
  }
}

}  // namespace
}  // namespace b4mrl
