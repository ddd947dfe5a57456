// Every task against its recordings, bit by bit: states, observations, rewards and flags, on past
// the end of the episodes.
#include <algorithm>
#include <cmath>

#include "tests/reference/mujoco_reference.h"
#include "tests/server/environments/simulation.h"

namespace b4mrl {
namespace {

std::shared_ptr<const Simulator> Open(const MujocoRecording& recording) {
  return Take(TryOpen(recording.environment, recording.perturbations, recording.config));
}

NamedState StartOf(const MujocoRow& row) {
  return {{"qpos", ToVector(row.qpos)}, {"qvel", ToVector(row.qvel)}};
}

void RequireState(const NamedState& state, const MujocoRow& row) {
  REQUIRE(EqualBytes(state.at("qpos"), row.qpos));
  REQUIRE(EqualBytes(state.at("qvel"), row.qvel));
  REQUIRE(EqualBytes(state.at("qacc_warmstart"), row.warmstart));
}

double RewardOf(const MujocoRecording& recording, const MujocoRow& row) {
  return recording.v5_reward ? row.reward_v5 : row.reward;
}

TEST_CASE("Every task replays its recordings bit for bit, saved and loaded at every step") {
  for (const MujocoRecording& recording : kMujocoRecordings) {
    INFO(recording.file << " " << recording.perturbations << " " << recording.config);
    const MujocoReference reference(recording);
    const auto simulator = Open(recording);
    // Two scratch simulators take turns, so nothing but the saved numbers can carry the trajectory.
    const Simulator::Lease scratch[] = {Take(simulator->Borrow()), Take(simulator->Borrow())};
    for (size_t i = 0; i < reference.trajectories(); ++i) {
      std::vector<double> state(simulator->state_size());
      std::vector<double> observation(simulator->spec().observation.size());
      RequireOk(scratch[0]->SetNamedState(StartOf(reference.Row(i, 0))));
      scratch[0]->SaveState(state);
      scratch[0]->Observe(observation);
      REQUIRE(EqualBytes(observation, reference.Row(i, 0).observation));
      for (size_t k = 1; k <= reference.steps(); ++k) {
        INFO("trajectory " << i << ", step " << k);
        const MujocoRow row = reference.Row(i, k);
        Environment& environment = *scratch[k % 2];
        environment.LoadState(state);
        const StepResult result = environment.Step(row.action);
        environment.SaveState(state);
        RequireState(environment.GetNamedState(), row);
        environment.Observe(observation);
        REQUIRE(EqualBytes(observation, row.observation));
        REQUIRE(result.reward == RewardOf(recording, row));
        REQUIRE(result.terminated == row.terminated);
        // A state that was only loaded looks the same.
        Environment& other = *scratch[(k + 1) % 2];
        other.LoadState(state);
        other.Observe(observation);
        REQUIRE(EqualBytes(observation, row.observation));
      }
    }
  }
}

TEST_CASE("Every MuJoCo task of the list has a recording of the original") {
  for (const EnvironmentEntry& entry : EnvironmentList()) {
    INFO(entry.name);
    if (std::ranges::count(Take(DescribeEnvironment(entry.name)).features, kMujocoModel) == 0)
      continue;
    CHECK(std::ranges::any_of(kMujocoRecordings, [&](const MujocoRecording& recording) {
      return recording.environment == entry.name && std::string(recording.perturbations).empty();
    }));
  }
}

TEST_CASE("Lanes that are never reset replay the recordings past the end of the episodes") {
  bool any_end = false;
  for (const MujocoRecording& recording : kMujocoRecordings) {
    INFO(recording.file << " " << recording.perturbations << " " << recording.config);
    const MujocoReference reference(recording);
    TestLane lane(Open(recording), AutoresetMode::kDisabled);
    for (size_t i = 0; i < reference.trajectories(); ++i) {
      lane.Reset();
      RequireOk(lane.TrySetState(StartOf(reference.Row(i, 0))));
      for (size_t k = 1; k <= reference.steps(); ++k) {
        const MujocoRow row = reference.Row(i, k);
        lane.Step(row.action);
        REQUIRE(EqualBytes(lane.observation(), row.observation));
        REQUIRE(lane.header().reward == RewardOf(recording, row));
        REQUIRE((lane.header().terminated == 1) == row.terminated);
        REQUIRE(lane.header().truncated == 0);
        REQUIRE((lane.header().cause == Cause::kUnhealthy) == row.terminated);
        any_end = any_end || row.terminated;
      }
    }
  }
  CHECK(any_end);
}

TEST_CASE("A query is one step from the state that its observation describes, whatever the task") {
  for (const MujocoRecording& recording : kMujocoRecordings) {
    INFO(recording.file << " " << recording.config);
    const MujocoShape& shape = recording.shape;
    const MujocoReference reference(recording);
    const auto simulator = Open(recording);
    const auto environment = Take(simulator->Borrow());
    size_t compared = 0;
    for (size_t k = 0; k < reference.steps(); ++k) {
      const MujocoRow row = reference.Row(0, k);
      const MujocoRow next = reference.Row(0, k + 1);
      const auto clipped = [&](double v) { return std::abs(v) >= shape.velocity_limit; };
      if (std::ranges::any_of(row.qvel, clipped)) continue;
      ++compared;
      std::vector<double> out(shape.observation);
      const QueryResult result =
          simulator->Query(*environment, {}, row.observation, next.action, out);
      REQUIRE(result.valid);
      REQUIRE(result.terminated == next.terminated);
      for (size_t i = 0; i < shape.positions - shape.hidden_positions; ++i) {
        REQUIRE(out[i] == Approx(next.observation[i]).margin(shape.query_tolerance).epsilon(0));
      }
      REQUIRE(result.reward ==
              Approx(RewardOf(recording, next)).margin(shape.query_reward_tolerance).epsilon(0));
    }
    REQUIRE(compared > 0);
  }
}

}  // namespace
}  // namespace b4mrl
