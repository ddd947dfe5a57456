// The recordings of the originals, replayed by a client through the daemon: every byte that it
// gets.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cstring>
#include <vector>

#include "tests/integration/support/daemon.h"
#include "tests/reference/mujoco_reference.h"

namespace b4mrl {
namespace {

void Append(std::vector<double>* to, std::span<const double> values) {
  to->insert(to->end(), values.begin(), values.end());
}

bool EqualBytes(std::span<const double> a, std::span<const double> b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size_bytes()) == 0;
}

// One session; its lanes are the recording's trajectories. Nothing resets, so that the lanes go on
// past the end of their episodes as the recordings do.
RemoteEnvironment OpenLanes(Client& client, const MujocoRecording& recording,
                            const MujocoReference& reference) {
  EnvironmentOptions options;
  options.simulator = Take(ParseNamedArguments(recording.perturbations));
  options.config = recording.config;
  options.num_envs = static_cast<uint32_t>(reference.trajectories());
  options.autoreset_mode = AutoresetMode::kDisabled;
  options.observation_dtype = DType::kFloat64;
  options.with_infos = true;
  options.deadline_ms = 60'000;
  RemoteEnvironment environment = Take(client.Make(recording.environment, options));
  RequireOk(environment.Reset().status());
  LaneStates start;
  start.lanes = reference.trajectories();
  std::vector<double> observations;
  for (size_t i = 0; i < reference.trajectories(); ++i) {
    Append(&start.parts["qpos"], reference.Row(i, 0).qpos);
    Append(&start.parts["qvel"], reference.Row(i, 0).qvel);
    Append(&observations, reference.Row(i, 0).observation);
  }
  const StepOutcome outcome = Take(environment.Restore(start));
  REQUIRE(EqualBytes(outcome.observations.As<double>(), observations));
  return environment;
}

TEST_CASE("Every recording replays through the socket bit by bit, past the ends of episodes too") {
  const PrivateDaemon daemon = StartDaemon();
  Client client = Connect(daemon.endpoint());
  for (const MujocoRecording& recording : kMujocoRecordings) {
    INFO(recording.file << " " << recording.config);
    const MujocoReference reference(recording);
    RemoteEnvironment environment = OpenLanes(client, recording, reference);
    const size_t infos = environment.spec().info_names.size();
    for (size_t k = 1; k <= reference.steps(); ++k) {
      INFO("step " << k);
      std::vector<double> actions, observations, rewards;
      std::vector<uint8_t> terminated;
      for (size_t i = 0; i < reference.trajectories(); ++i) {
        const MujocoRow row = reference.Row(i, k);
        Append(&actions, row.action);
        Append(&observations, row.observation);
        rewards.push_back(recording.v5_reward ? row.reward_v5 : row.reward);
        terminated.push_back(row.terminated);
      }
      const StepOutcome outcome = Take(environment.Step(std::span<const double>(actions)));
      REQUIRE(EqualBytes(outcome.observations.As<double>(), observations));
      REQUIRE(EqualBytes(outcome.rewards, rewards));
      const std::vector<uint8_t> got(outcome.terminated.begin(), outcome.terminated.end());
      REQUIRE(got == terminated);
      for (const uint8_t truncated : outcome.truncated) REQUIRE(truncated == 0);
      const size_t ended = outcome.final_lanes.size();
      REQUIRE(ended == static_cast<size_t>(std::count(got.begin(), got.end(), 1)));
      REQUIRE(outcome.infos.size() == reference.trajectories() * infos);
      REQUIRE(outcome.final_infos.size() == ended * infos);
      for (size_t i = 0; i < ended; ++i) {
        // Nothing resets, so what ended is what is there.
        const uint32_t lane = outcome.final_lanes[i];
        REQUIRE(EqualBytes(outcome.final_infos.subspan(i * infos, infos),
                           outcome.infos.subspan(lane * infos, infos)));
      }
    }
  }
}

TEST_CASE("float32 actions and observations are the float64 ones, rounded") {
  const PrivateDaemon daemon = StartDaemon();
  Client client = Connect(daemon.endpoint());
  const MujocoReference reference("hopper", kHopperShape);
  EnvironmentOptions small;
  small.autoreset_mode = AutoresetMode::kDisabled;
  RemoteEnvironment environment = Take(client.Make("Hopper", small));
  RequireOk(environment.Reset().status());
  LaneStates start;
  start.lanes = 1;
  Append(&start.parts["qpos"], reference.Row(0, 0).qpos);
  Append(&start.parts["qvel"], reference.Row(0, 0).qvel);
  RequireOk(environment.Restore(start).status());
  for (size_t k = 1; k <= reference.steps(); ++k) {
    const MujocoRow row = reference.Row(0, k);
    const std::vector<float> action(row.action.begin(), row.action.end());  // exact
    const StepOutcome outcome = Take(environment.Step(std::span<const float>(action)));
    const std::vector<float> expected(row.observation.begin(), row.observation.end());
    const std::span<const float> got = outcome.observations.As<float>();
    REQUIRE(std::vector<float>(got.begin(), got.end()) == expected);
    REQUIRE(outcome.rewards[0] == row.reward);
    REQUIRE(outcome.infos.empty());
  }
}

}  // namespace
}  // namespace b4mrl
