// The recordings of highway-env, replayed by a client through the daemon.
#include <catch2/catch.hpp>
#include <cmath>
#include <vector>

#include "tests/integration/support/daemon.h"
#include "tests/server/highway/highway_reference.h"

namespace b4mrl {
namespace {

// Of states and rewards, as tests/server/highway/simulation_test.cc explains; observations are
// float32 numbers and differ only where that rounding does.
constexpr double kMargin = 1e-9;
constexpr double kObservationMargin = 1e-6;

RemoteEnvironment OpenAtStart(Client& client, const HighwayTrajectory& t) {
  EnvironmentOptions options;
  options.config = t.config;
  options.seed = t.seed;
  options.autoreset_mode = AutoresetMode::kDisabled;
  options.observation_dtype = DType::kFloat64;
  RemoteEnvironment environment = Take(client.Make("Highway", options));
  for (uint64_t reset = 0; reset <= t.episode; ++reset) Take(environment.Reset());
  if (t.scrambled) {
    LaneStates start;
    start.lanes = 1;
    start.parts["vehicles"] = {t.initial_vehicles.begin(), t.initial_vehicles.end()};
    Take(environment.Restore(start));
  }
  return environment;
}

Result<StepOutcome> Step(RemoteEnvironment& environment, const HighwayTrajectory& t,
                         const HighwayStep& step) {
  if (!t.float32) return environment.Step(step.action);
  const std::vector<float> action(step.action.begin(), step.action.end());  // exact
  return environment.Step(std::span<const float>(action));
}

void CheckStates(RemoteEnvironment& environment, const HighwayTrajectory& t,
                 const HighwayStep& step) {
  const LaneStates states = Take(environment.Snapshot());
  const std::vector<double>& vehicles = states.parts.at("vehicles");
  REQUIRE(vehicles.size() == t.vehicles * kVehicleColumns);
  for (size_t i = 0; i < step.states.size(); ++i) {
    const size_t row = i / kRecordedColumns, column = i % kRecordedColumns;
    REQUIRE(std::abs(vehicles[row * kVehicleColumns + column] - step.states[i]) <= kMargin);
  }
}

TEST_CASE("Every recording of highway-env replays through the socket, past the ends too") {
  const PrivateDaemon daemon = StartDaemon();
  Client client = Connect(daemon.endpoint());
  for (const HighwayTrajectory& t : ReadHighwayTrajectories()) {
    INFO(t.name);
    RemoteEnvironment environment = OpenAtStart(client, t);
    for (size_t i = 0; i < t.steps.size(); ++i) {
      INFO("step " << i);
      const HighwayStep& step = t.steps[i];
      const StepOutcome outcome = Take(Step(environment, t, step));
      CHECK((outcome.terminated[0] != 0) == step.terminated);
      CHECK((outcome.truncated[0] != 0) == step.truncated);
      if (i >= t.strict_steps) continue;
      CHECK(std::abs(outcome.rewards[0] - step.reward) <= kMargin);
      const std::span<const double> observation = outcome.observations.As<double>();
      REQUIRE(observation.size() == step.observation.size());
      for (size_t k = 0; k < observation.size(); ++k) {
        const double scale = std::max(1.0, std::abs(step.observation[k]));
        REQUIRE(std::abs(observation[k] - step.observation[k]) <= kObservationMargin * scale);
      }
      CheckStates(environment, t, step);
    }
  }
}

}  // namespace
}  // namespace b4mrl
