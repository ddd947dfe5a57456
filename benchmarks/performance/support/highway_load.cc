#include "benchmarks/performance/support/highway_load.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "proto/base/rng.h"
#include "server/highway/observation.h"
#include "server/highway/road.h"

namespace b4mrl::perf {
namespace {

constexpr double kSteering = 0.02;  // greatest steering, as a fraction of the full range

}  // namespace

HighwaySettings HighwayTask() {
  HighwaySettings settings;
  settings.vehicles_count = 15;
  return settings;
}

std::vector<float> HighwayActions(size_t rows) {
  Rng rng(0, "perf-highway-actions");
  std::vector<float> actions;
  for (size_t row = 0; row < rows; ++row) {
    actions.push_back(static_cast<float>(rng.Uniform(-1, 1)));
    actions.push_back(static_cast<float>(rng.Uniform(-kSteering, kSteering)));
  }
  return actions;
}

BareHighway::BareHighway(const HighwaySettings& settings, uint64_t seed)
    : settings_(settings),
      simulation_(settings, settings.vehicles_count + 1),
      seed_(seed),
      observation_(settings.observation.size()) {}

void BareHighway::Step(std::span<const float> action) {
  if (ended_) simulation_.Reset(seed_, episode_++);
  const std::array<double, kHighwayActionSize> numbers = {action[0], action[1]};
  simulation_.Step(MapAction(settings_.action, numbers, true));
  ObserveTraffic(settings_.observation, simulation_.traffic, observation_);
  ended_ = simulation_.Judge().terminated || simulation_.TimeIsOver();
}

LibraryCalls::LibraryCalls(const HighwaySettings& settings, std::span<const float> actions,
                           size_t steps)
    : steps_(steps), lanes_(settings.lanes_count), neighbours_(settings.vehicles_count + 1) {
  HighwaySimulation simulation(settings, settings.vehicles_count + 1);
  const int frames = static_cast<int>(settings.simulation_frequency / settings.policy_frequency);
  uint64_t episode = 0;
  bool ended = true;
  for (size_t step = 0; step < steps; ++step) {
    if (ended) simulation.Reset(0, episode++);
    const size_t row = step * kHighwayActionSize % actions.size();
    const std::array<double, kHighwayActionSize> action = {actions[row], actions[row + 1]};
    const HighwayCommand command = MapAction(settings.action, action, true);
    simulation.traffic.acceleration[kEgo] = command.acceleration;
    simulation.traffic.steering[kEgo] = command.steering;
    simulation.time += 1 / settings.policy_frequency;
    for (int frame = 0; frame < frames; ++frame) {
      const Traffic before = simulation.traffic;
      simulation.Advance();
      RecordFrame(before, simulation.traffic);
    }
    ended = simulation.Judge().terminated || simulation.TimeIsOver();
  }
}

void LibraryCalls::RecordFrame(const Traffic& before, const Traffic& after) {
  const auto add = [](std::vector<double>& calls, double argument) {
    if (argument != 0) calls.push_back(argument);
  };
  neighbours_.Update(before, lanes_);
  for (int i = 0; i < before.count; ++i) {
    const bool drives = i != kEgo && !before.crashed[i];
    const double speed = before.speed[i];
    if (drives) {
      RecordPower(before, i, before.delta[i]);
      RecordThought(before, i);
      const double offset = before.y[i] - LaneCentre(after.target_lane[i]);
      const double command = std::clamp(-offset / 0.6 / speed, -1.0, 1.0);
      add(arc_sines_, command);
      const double slip =
          std::clamp(12.5 / speed * WrapAngle(std::asin(command) - before.heading[i]), -1.0, 1.0);
      add(arc_sines_, slip);
      add(tangents_, std::asin(slip));
      add(arc_tangents_, 2 * std::tan(std::asin(slip)));
    }
    const double steering = after.steering[i];
    const double slip = std::atan(0.5 * std::tan(steering));
    add(tangents_, steering);
    add(arc_tangents_, 0.5 * std::tan(steering));
    add(sines_, slip);
    if (slip != 0) add(angles_, before.heading[i] + slip);
    if (after.heading[i] != before.heading[i]) add(angles_, after.heading[i]);
  }
}

void LibraryCalls::RecordPower(const Traffic& t, int vehicle, double exponent) {
  const double wanted = vehicle == kEgo ? 0.01 : t.target_speed[vehicle];
  powers_.push_back({std::max(t.speed[vehicle], 0.0) / wanted, exponent});
}

// Records the powers of a decision on a lane change: the free acceleration of the car behind on
// either side.
void LibraryCalls::RecordThought(const Traffic& t, int vehicle) {
  const int lane = t.lane[vehicle];
  if (lane != t.target_lane[vehicle] || !(t.timer[vehicle] > 1)) return;
  for (const int side : {lane - 1, lane + 1}) {
    if (side < 0 || side >= lanes_) continue;
    const int follower = neighbours_.Rear(vehicle, side);
    if (follower != kNoVehicle) RecordPower(t, follower, t.delta[vehicle]);
  }
}

double LibraryCalls::Repeat() const {
  double sum = 0;
  for (const Power& power : powers_) sum += std::pow(power.base, power.exponent);
  for (const double x : angles_) sum += std::sin(x) + std::cos(x);
  for (const double x : sines_) sum += std::sin(x);
  for (const double x : tangents_) sum += std::tan(x);
  for (const double x : arc_sines_) sum += std::asin(x);
  for (const double x : arc_tangents_) sum += std::atan(x);
  return sum;
}

size_t LibraryCalls::size() const {
  return powers_.size() + 2 * angles_.size() + sines_.size() + tangents_.size() +
         arc_sines_.size() + arc_tangents_.size();
}

}  // namespace b4mrl::perf
