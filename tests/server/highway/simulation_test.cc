// The simulator against trajectories recorded from highway-env.
#include "server/highway/simulation.h"

#include <algorithm>
#include <cmath>

#include "server/environments/highway_config.h"
#include "server/highway/observation.h"
#include "tests/server/environments/simulation.h"
#include "tests/server/highway/highway_reference.h"

namespace b4mrl {
namespace {

// The original calls NumPy's sine and cosine, we the C library's: they differ by an ulp. Over the
// recorded steps that grows to at most 2e-13; the margin is what the recordings are good for.
constexpr double kStateMargin = 1e-9;
constexpr double kObservationMargin = 1e-6;  // of float32 numbers around 1

HighwaySettings SettingsOf(const std::string& config) {
  return ReadHighwaySettings(Take(CompleteHighwayConfig(Take(ParseConfig(config)))));
}

struct TestHighway {
  explicit TestHighway(const std::string& config)
      : settings(SettingsOf(config)),
        simulation(settings, std::max(settings.vehicles_count + 1, settings.observation.rows)) {}

  void Set(std::span<const double> vehicles) {
    simulation.time = 0;
    simulation.traffic.Clear();
    for (size_t at = 0; at < vehicles.size(); at += kVehicleColumns) {
      simulation.traffic.Set(simulation.traffic.count++, vehicles.subspan(at, kVehicleColumns),
                             settings.lanes_count);
    }
  }
  std::vector<double> Vehicles() const {
    std::vector<double> vehicles(simulation.traffic.count * kVehicleColumns);
    for (int i = 0; i < simulation.traffic.count; ++i) {
      simulation.traffic.Get(i, std::span(vehicles).subspan(i * kVehicleColumns, kVehicleColumns));
    }
    return vehicles;
  }
  std::vector<double> Observation() const {
    std::vector<double> observation(settings.observation.size());
    ObserveTraffic(settings.observation, simulation.traffic, observation);
    return observation;
  }

  HighwaySettings settings;
  HighwaySimulation simulation;
};

double LargestDifference(std::span<const double> a, std::span<const double> b) {
  REQUIRE(a.size() == b.size());
  double largest = 0;
  for (size_t i = 0; i < a.size(); ++i) largest = std::max(largest, std::abs(a[i] - b[i]));
  return largest;
}

// Relative to their size where they are not normalised.
double ObservationDifference(std::span<const double> a, std::span<const double> b) {
  REQUIRE(a.size() == b.size());
  double largest = 0;
  for (size_t i = 0; i < a.size(); ++i) {
    largest = std::max(largest, std::abs(a[i] - b[i]) / std::max(1.0, std::abs(b[i])));
  }
  return largest;
}

void CheckStates(const TestHighway& highway, std::span<const double> recorded) {
  const std::vector<double> vehicles = highway.Vehicles();
  for (int i = 0; i < highway.simulation.traffic.count; ++i) {
    INFO("car " << i);
    CHECK(LargestDifference(std::span(vehicles).subspan(i * kVehicleColumns, kRecordedColumns),
                            recorded.subspan(i * kRecordedColumns, kRecordedColumns)) <=
          kStateMargin);
  }
}

TEST_CASE("Every seed and reset starts as the original does") {
  for (const HighwayTrajectory& t : ReadHighwayTrajectories()) {
    if (t.scrambled) continue;
    INFO(t.name);
    TestHighway highway(t.config);
    highway.simulation.Reset(t.seed, t.episode);
    CHECK(LargestDifference(highway.Vehicles(), t.initial_vehicles) <= 1e-12);  // exp's last bit
  }
}

TEST_CASE("Recorded trajectories are followed to rounding, with every flag, past the end too") {
  for (const HighwayTrajectory& t : ReadHighwayTrajectories()) {
    INFO(t.name);
    TestHighway highway(t.config);
    highway.Set(t.initial_vehicles);
    CHECK(ObservationDifference(highway.Observation(), t.initial_observation) <=
          kObservationMargin);
    for (size_t i = 0; i < t.steps.size(); ++i) {
      INFO("step " << i);
      const HighwayStep& step = t.steps[i];
      highway.simulation.Step(MapAction(highway.settings.action, step.action, t.float32));
      const HighwayOutcome outcome = highway.simulation.Judge();
      CHECK(outcome.terminated == step.terminated);
      CHECK(highway.simulation.TimeIsOver() == step.truncated);
      CHECK(outcome.on_road == step.on_road);
      if (i >= t.strict_steps) continue;  // a wobbling car: rounding grows without bound
      CheckStates(highway, step.states);
      CHECK(std::abs(outcome.reward - step.reward) <= kStateMargin);
      CHECK(ObservationDifference(highway.Observation(), step.observation) <= kObservationMargin);
    }
  }
}

TEST_CASE("Single frames are followed, not only whole steps") {
  size_t frames = 0;
  for (const HighwayTrajectory& t : ReadHighwayTrajectories()) {
    if (t.frames.empty()) continue;
    TestHighway highway(t.config);
    highway.Set(t.initial_vehicles);
    const size_t frames_per_step = 15;
    for (size_t i = 0; i < t.frames.size(); ++i) {
      if (i % frames_per_step == 0) {
        const HighwayStep& step = t.steps[i / frames_per_step];
        const HighwayCommand command = MapAction(highway.settings.action, step.action, t.float32);
        highway.simulation.traffic.acceleration[kEgo] = command.acceleration;
        highway.simulation.traffic.steering[kEgo] = command.steering;
      }
      highway.simulation.Advance();
      CheckStates(highway, t.frames[i]);
      ++frames;
    }
  }
  CHECK(frames == 30);
}

TEST_CASE("Actions that came as float32 are mapped in float32") {
  const HighwayActionSettings settings;
  const std::array<double, 2> action = {0.5, 0.5f};
  const HighwayCommand exact = MapAction(settings, action, false);
  const HighwayCommand rounded = MapAction(settings, action, true);
  CHECK(exact.acceleration == 2.5);
  CHECK(rounded.acceleration == 2.5);
  CHECK(exact.steering != rounded.steering);
  CHECK(rounded.steering == static_cast<float>(rounded.steering));
  CHECK(exact.steering == Approx(rounded.steering).epsilon(1e-7));  // float32's precision
}

TEST_CASE("Cars at the same place have the neighbours that the list's order gives") {
  Traffic traffic(5);
  traffic.count = 5;
  for (int i = 0; i < 5; ++i) traffic.x[i] = i < 3 ? 100 : 90 + i;  // 100, 100, 100, 93, 94
  traffic.y = {0, 0, 0, 0, 3.5};                                    // the last is on lanes 0 and 1
  Neighbours neighbours(5);
  neighbours.Update(traffic, 2);
  CHECK(neighbours.Front(3, 0) == 2);  // 94 is not on lane 0 with a margin of 1
  CHECK(neighbours.Front(3, 1) == 4);
  CHECK(neighbours.Front(0, 0) == 2);
  CHECK(neighbours.Front(2, 0) == 1);
  CHECK(neighbours.Rear(1, 0) == 3);
  CHECK(neighbours.Rear(1, 1) == 4);
  CHECK(neighbours.Front(0, 1) == kNoVehicle);
}

// What Neighbours answers fast, asked slowly.
int SlowNeighbour(const Traffic& t, int vehicle, int lane, bool front) {
  int best = kNoVehicle;
  for (int other = 0; other < t.count; ++other) {
    if (other == vehicle || std::abs(t.y[other] - 4 * lane) > 3) continue;
    const double ahead = t.x[other] - t.x[vehicle];
    if (front ? ahead < 0 : ahead >= 0) continue;
    if (best == kNoVehicle || (front ? t.x[other] <= t.x[best] : t.x[other] > t.x[best])) {
      best = other;
    }
  }
  return best;
}

TEST_CASE("Neighbours are those of a search through the whole list, for up to 128 cars") {
  for (const int count : {1, 2, 17, 64, 65, 128}) {
    Traffic traffic(count);
    traffic.count = count;
    Rng rng(7, "test-neighbours", count);
    for (int i = 0; i < count; ++i) {
      traffic.x[i] = rng.Uniform(0, 500);
      traffic.y[i] = rng.Uniform(-4, 16);
    }
    Neighbours neighbours(count);
    neighbours.Update(traffic, 4);
    for (int i = 0; i < count; ++i) {
      for (int lane = 0; lane < 4; ++lane) {
        CHECK(neighbours.Front(i, lane) == SlowNeighbour(traffic, i, lane, true));
        CHECK(neighbours.Rear(i, lane) == SlowNeighbour(traffic, i, lane, false));
      }
    }
  }
}

}  // namespace
}  // namespace b4mrl
