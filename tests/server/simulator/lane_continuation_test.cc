// How a lane goes on after what it was doing was broken off: by a crash, or by a state that is set.
#include <cmath>

#include "proto/base/finite.h"
#include "tests/server/environments/simulation.h"

namespace b4mrl {
namespace {

constexpr const char* kThreeSteps = R"({"max_episode_steps": 3})";

std::vector<double> Action(uint64_t step) { return RandomAction(6, 1, step); }

TEST_CASE("After a crash the episode ends as truncated at its last observation") {
  for (const AutoresetMode mode :
       {AutoresetMode::kNextStep, AutoresetMode::kSameStep, AutoresetMode::kDisabled}) {
    TestLane lane(OpenHalfCheetah(), mode);
    lane.Reset();
    for (uint64_t k = 0; k < 5; ++k) lane.Step(Action(k));
    const std::vector<double> last = lane.observation();
    const double episode_return = lane.header().episode_return;
    lane.TruncateAfterCrash();
    REQUIRE(lane.header().cause == Cause::kCrash);
    REQUIRE(lane.header().truncated == 1);
    REQUIRE(lane.header().reward == 0);
    REQUIRE(lane.header().final_length == 6);
    REQUIRE(lane.header().final_return == episode_return);
    REQUIRE(lane.final_observation() == last);
    if (mode == AutoresetMode::kSameStep) {
      REQUIRE(lane.header().phase == LanePhase::kRunning);
      REQUIRE(lane.observation() != last);
    } else {
      REQUIRE(lane.header().phase == LanePhase::kEnded);
      REQUIRE(lane.observation() == last);
    }
  }
}

TEST_CASE("A reset that crashes moves on to another start") {
  TestLane lane(OpenHalfCheetah("", kThreeSteps));
  lane.Reset();
  for (uint64_t k = 0; k < 3; ++k) lane.Step(Action(k));
  lane.TruncateAfterCrash();  // instead of the auto-reset to episode 1
  REQUIRE(lane.header().final_length == 0);
  lane.Step(Action(3));
  REQUIRE(lane.header().episode == 2);
  REQUIRE(lane.header().phase == LanePhase::kRunning);
}

TEST_CASE("A step past the end that crashes is one more step of its episode, not a start") {
  TestLane lane(OpenHalfCheetah("", kThreeSteps), AutoresetMode::kDisabled);
  lane.Reset();
  for (uint64_t k = 0; k < 4; ++k) lane.Step(Action(k));
  const double episode_return = lane.header().episode_return;
  lane.TruncateAfterCrash();
  REQUIRE(lane.header().final_length == 5);
  REQUIRE(lane.header().final_return == episode_return);
  REQUIRE(lane.header().episode == 0);
}

TEST_CASE("A state that is set where an episode has ended begins the next one, with new noise") {
  TestLane lane(OpenHalfCheetah("obs-noise=0.5", kThreeSteps), AutoresetMode::kDisabled);
  lane.Reset();
  const NamedState state = lane.GetState();
  std::vector<std::vector<double>> observations;
  for (uint64_t episode = 0; episode < 3; ++episode) {
    if (episode > 0) RequireOk(lane.TrySetState(state));
    REQUIRE(lane.header().episode == episode);
    observations.push_back(lane.observation());
    for (uint64_t k = 0; k < 3; ++k) lane.Step(Action(k));
    REQUIRE(lane.header().phase == LanePhase::kEnded);
  }
  REQUIRE(observations[1] != observations[0]);
  REQUIRE(observations[2] != observations[1]);
  TestLane fresh(OpenHalfCheetah("", kThreeSteps));
  RequireOk(fresh.TrySetState(state));
  REQUIRE(fresh.header().episode == 0);
}

TEST_CASE("A state that is set leaves none that is not finite, and can be set again whole") {
  TestLane lane(OpenHalfCheetah());
  lane.Reset();
  size_t taken = 0;
  for (uint64_t k = 0; k < 400; ++k) {
    // Of every order of magnitude that is accepted.
    Rng rng(k, "test-state");
    const double scale = std::pow(10.0, rng.Uniform(-3, 10));
    NamedState state = {{"qpos", std::vector<double>(9)}, {"qvel", std::vector<double>(9)}};
    for (auto& [name, values] : state) {
      for (double& value : values) value = rng.Uniform(-scale, scale);
    }
    if (!lane.TrySetState(state).ok()) continue;
    ++taken;
    const NamedState whole = lane.GetState();
    for (const auto& [name, values] : whole) REQUIRE(AllFinite(values));
    RequireOk(lane.TrySetState(whole));
    REQUIRE(lane.GetState() == whole);
  }
  CHECK(taken > 200);
}

}  // namespace
}  // namespace b4mrl
