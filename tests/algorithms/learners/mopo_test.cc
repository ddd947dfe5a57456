// MOPO as a learner: what its batches are made of. A fake daemon serves its dataset.
#include <catch2/catch.hpp>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "algorithms/policy/inference.h"
#include "tests/algorithms/learners/small_model_based.h"

namespace b4mrl {

TEST_CASE("A batch of MOPO's has as many rows of the dataset as its real-ratio says") {
  const double real_ratio = GENERATE(0.0, 0.25, 0.75);
  // Without a discount a target is its row's reward.
  SmallModelBased mopo("mopo", {{"real-ratio", real_ratio}, {"gamma", 0}, {"penalty", 0}});
  // The model's rewards are a few tenths, its noise at most 1.3 a row; a row more or less of the
  // dataset's would be 100 / 64.
  CHECK(Update(*mopo.CreatePrepared(), 1)["mean_target"] ==
        Approx(kWalkersReward * real_ratio).margin(0.7));
}

TEST_CASE("MOPO's penalty lowers the rewards that its policy learns from") {
  const auto mean_target = [](double penalty) {
    SmallModelBased mopo("mopo", {{"real-ratio", 0}, {"gamma", 0}, {"penalty", penalty}});
    return Update(*mopo.CreatePrepared(), 1)["mean_target"];
  };
  // The deviations of an untrained network are about 0.8, and the norm of all four about 1.6.
  const double plain = mean_target(0), penalised = mean_target(100);
  CHECK(plain - penalised > 100);
  CHECK(plain - penalised < 250);
}

TEST_CASE("MOPO draws other rows of its rollouts in every update") {
  SmallModelBased mopo("mopo", {{"real-ratio", 0}, {"gamma", 0}});
  const std::unique_ptr<Learner> learner = mopo.CreatePrepared();
  // Of one cycle. Without a discount a target is its row's reward, whatever the networks learn.
  const double first = Update(*learner, 1)["mean_target"];
  CHECK(Update(*learner, 1)["mean_target"] != first);
}

TEST_CASE("MOPO rolls out at the start of each cycle, and keeps and begins as many as told") {
  const int lag = GENERATE(0, 1);
  SmallModelBased mopo("mopo", {{"rollout-every", 2}, {"model-retain", 2}, {"rollout-lag", lag}});
  const std::unique_ptr<Learner> learner = mopo.CreatePrepared();
  for (int update = 0; update < 6; ++update) {
    CHECK(Update(*learner, 1).contains("rollout_reward") == (update % 2 == 0));
  }
  CheckpointWriter writer = Take(CheckpointWriter::Create(mopo.File("checkpoint.h5")));
  RequireOk(learner->Save(writer));
  RequireOk(writer.Commit());
  CheckpointReader reader = Take(CheckpointReader::Open(mopo.File("checkpoint.h5")));
  CHECK(reader.Unsigned("generations") == 2);  // of three
  CHECK(reader.Unsigned("pending") == static_cast<uint64_t>(lag));
}

TEST_CASE("MOPO's rollouts do not end by a dimension that its dataset hides") {
  const auto terminated = [](std::vector<uint32_t> hidden) {
    SmallModelBased mopo("mopo", {{"horizon", 3}, {"rollout-every", 1}}, std::move(hidden));
    return Update(*mopo.CreatePrepared(), 1)["rollout_terminated_rows"];
  };
  CHECK(terminated({}) > 10);
  CHECK(terminated({0, 1}) == 0);
}

TEST_CASE(
    "Rollouts of cycles before the last ones are forgotten, though rows that end leave room") {
  SmallModelBased mopo("mopo", {{"horizon", 3}, {"real-ratio", 0}});
  const std::unique_ptr<Learner> straight = mopo.CreatePrepared();
  // One update into the second cycle.
  CHECK(Update(*straight, 4)["rollout_terminated_rows"] > 10);

  // A checkpoint names the cycles that are kept, so who reads it has those rollouts alone.
  CheckpointWriter writer = Take(CheckpointWriter::Create(mopo.File("checkpoint.h5")));
  RequireOk(straight->Save(writer));
  RequireOk(writer.Commit());
  const std::unique_ptr<Learner> resumed = mopo.Create();
  CheckpointReader reader = Take(CheckpointReader::Open(mopo.File("checkpoint.h5")));
  RequireOk(resumed->Load(reader));
  CHECK(Update(*straight, 1) == Update(*resumed, 1));
  CHECK(FlattenPolicy(straight->Policy()) == FlattenPolicy(resumed->Policy()));
}

}  // namespace b4mrl
