// What the Humanoid has beyond the planar tasks: numbers that lag behind its state, contact forces,
// a quaternion, and many contacts at once.
#include <algorithm>

#include "tests/reference/mujoco_reference.h"
#include "tests/server/environments/simulation.h"

namespace b4mrl {
namespace {

std::shared_ptr<const Simulator> Open(const std::string& config = "") {
  return Take(TryOpen("Humanoid", "", config));
}

NamedState StartOf(const MujocoRow& row) {
  return {{"qpos", ToVector(row.qpos)}, {"qvel", ToVector(row.qvel)}};
}

TEST_CASE("Version 5 observes what version 4 does but for the numbers that are always 0") {
  const MujocoReference reference("humanoid", kHumanoidShape);
  const auto simulator = Open(R"({"version": "v5"})");
  const auto environment = Take(simulator->Borrow());
  for (size_t i = 0; i < reference.trajectories(); ++i) {
    RequireOk(environment->SetNamedState(StartOf(reference.Row(i, 0))));
    for (size_t k = 1; k <= reference.steps(); ++k) {
      const MujocoRow row = reference.Row(i, k);
      const StepResult result = environment->Step(row.action);
      REQUIRE(result.reward == row.reward_v5);
      REQUIRE(result.terminated == row.terminated);
      // The world's blocks and the root's actuator forces.
      std::vector<double> expected;
      for (size_t d = 0; d < row.observation.size(); ++d) {
        const bool dropped = (d >= 45 && d < 55) || (d >= 185 && d < 191) ||
                             (d >= 269 && d < 275) || (d >= 292 && d < 298);
        if (dropped) REQUIRE(row.observation[d] == 0);
        if (!dropped) expected.push_back(row.observation[d]);
      }
      std::vector<double> observation(simulator->spec().observation.size());
      environment->Observe(observation);
      REQUIRE(EqualBytes(observation, expected));
    }
  }
}

TEST_CASE("The contact cost is weighted and clipped as set") {
  const MujocoReference reference("humanoid", kHumanoidShape);
  const auto contact_cost = [&](const std::string& settings) {
    const auto simulator = Open(R"({"version": "v5", )" + settings + "}");
    const auto environment = Take(simulator->Borrow());
    RequireOk(environment->SetNamedState(StartOf(reference.Row(0, 0))));
    for (size_t k = 1; k <= reference.steps(); ++k) environment->Step(reference.Row(0, k).action);
    std::vector<double> infos(simulator->spec().info_names.size());
    environment->Infos(infos);
    REQUIRE(simulator->spec().info_names.back() == "reward_contact");
    return -infos.back();
  };
  const double plain = contact_cost(R"("contact_cost_weight": 1e-9)");
  REQUIRE(plain > 0);
  CHECK(contact_cost(R"("contact_cost_weight": 2e-9)") == Approx(2 * plain).epsilon(1e-12));
  CHECK(contact_cost(R"("contact_cost_weight": 1, "contact_cost_range": [null, 2.5])") == 2.5);
  CHECK(contact_cost(R"("contact_cost_weight": 0, "contact_cost_range": [1.5, null])") == 1.5);
}

TEST_CASE("A state put back at any step of an episode continues with the same bits") {
  const auto simulator = Open();
  TestLane copy(simulator, AutoresetMode::kDisabled);
  for (uint64_t seed = 0; seed < 8; ++seed) {
    TestLane original(simulator, AutoresetMode::kDisabled);
    original.Reset(seed);
    for (uint64_t k = 0; k < 20; ++k) {
      RequireOk(copy.TrySetState(original.GetState()));
      original.StepRandomly(k);
      copy.StepRandomly(k);
      REQUIRE(copy.state() == original.state());
    }
  }
}

TEST_CASE("A state read from a lane and put into another shows and continues the same bits") {
  const auto simulator = Open();
  TestLane original(simulator, AutoresetMode::kDisabled);
  original.Reset(7);
  for (uint64_t k = 0; k < 12; ++k) original.StepRandomly(k);
  TestLane copy(simulator, AutoresetMode::kDisabled);
  RequireOk(copy.TrySetState(original.GetState()));
  REQUIRE(copy.state() == original.state());
  REQUIRE(copy.observation() == original.observation());
  for (uint64_t k = 12; k < 30; ++k) {
    original.StepRandomly(k);
    copy.StepRandomly(k);
    REQUIRE(copy.state() == original.state());
    REQUIRE(copy.observation() == original.observation());
    REQUIRE(copy.header().reward == original.header().reward);
  }
}

TEST_CASE("Without the lagging centre of mass the first reward differs, and only that one") {
  const auto simulator = Open();
  TestLane original(simulator, AutoresetMode::kDisabled);
  original.Reset(7);
  for (uint64_t k = 0; k < 12; ++k) original.StepRandomly(k);
  NamedState state = original.GetState();
  REQUIRE(state.erase("com") == 1);
  TestLane copy(simulator, AutoresetMode::kDisabled);
  RequireOk(copy.TrySetState(state));
  const double lag = copy.GetState().at("com")[0] - original.GetState().at("com")[0];
  REQUIRE(lag != 0);
  original.StepRandomly(12);
  copy.StepRandomly(12);
  REQUIRE(copy.header().reward != original.header().reward);
  // A metre is paid for with 1.25 / 0.015 s. Positions of about a metre round by 1e-16, and 83 of
  // that are 1e-14.
  REQUIRE(copy.header().reward ==
          Approx(original.header().reward - 1.25 / 0.015 * lag).margin(1e-12).epsilon(0));
  REQUIRE(copy.state() == original.state());
}

TEST_CASE("A quaternion is normalised, and zeros are upright") {
  const auto simulator = Open();
  const auto environment = Take(simulator->Borrow());
  Rng rng(1, "reset");
  RequireOk(environment->Reset(rng));
  std::vector<double> observation(376);
  environment->Observe(observation);
  // What a query makes of the observation with that quaternion.
  const auto next_of = [&](std::vector<double> quaternion) {
    std::vector<double> start = observation, next(376);
    std::ranges::copy(quaternion, start.begin() + 1);
    REQUIRE(environment->Query(start, std::vector<double>(17, 0.0), next).valid);
    return next;
  };
  CHECK(next_of({2, 0, 0, 0}) == next_of({1, 0, 0, 0}));
  CHECK(next_of({0, 0, 0, 0}) == next_of({1, 0, 0, 0}));
  CHECK(next_of({0, 2, 0, 0}) != next_of({1, 0, 0, 0}));
}

TEST_CASE("Noise of any size in an observation leaves queries valid") {
  // Every joint anywhere and the torso in the floor: contacts and limits beyond what play reaches.
  const auto simulator = Open();
  const auto environment = Take(simulator->Borrow());
  Rng rng(5, "test-noise");
  Rng reset(1, "reset");
  RequireOk(environment->Reset(reset));
  std::vector<double> start(376);
  environment->Observe(start);
  for (const double scale : {0.1, 0.5, 1.0, 3.0}) {
    for (int i = 0; i < 100; ++i) {
      std::vector<double> observation = start;
      for (size_t d = 0; d < 22; ++d) observation[d] += scale * rng.Normal();
      observation[0] = rng.Uniform(-0.5, 1.5);
      std::vector<double> next(376);
      const std::vector<double> action = RandomAction(17, 1, i);
      INFO("scale " << scale << ", row " << i);
      REQUIRE(simulator->Query(*environment, {}, observation, action, next).valid);
    }
  }
}

}  // namespace
}  // namespace b4mrl
