#include "server/highway/simulation.h"

#include <algorithm>
#include <cmath>

#include "server/highway/creation.h"
#include "server/highway/driver.h"
#include "server/highway/motion.h"
#include "server/highway/road.h"

namespace b4mrl {
namespace {

// Maps [-1, 1] to `range`; Number is the type in which every operation is rounded.
template <typename Number>
double MapComponent(double component, const NumberRange& range, bool clip) {
  auto a = static_cast<Number>(component);
  if (clip) a = std::clamp(a, Number{-1}, Number{1});
  const auto low = static_cast<Number>(range.low);
  const auto width = static_cast<Number>(range.high - range.low);
  return low + (a + 1) * width / 2;
}

double Component(double component, const NumberRange& range, bool clip, bool single_precision) {
  return single_precision ? MapComponent<float>(component, range, clip)
                          : MapComponent<double>(component, range, clip);
}

// Python's a // b for positive floats, which is not always the floor of the rounded quotient.
int FloorDivide(double a, double b) {
  return static_cast<int>(std::round((a - std::fmod(a, b)) / b));
}

}  // namespace

HighwayCommand MapAction(const HighwayActionSettings& settings, std::span<const double> action,
                         bool single_precision) {
  HighwayCommand command;
  if (settings.longitudinal) {
    command.acceleration =
        Component(action[0], settings.acceleration_range, settings.clip, single_precision);
  }
  if (settings.lateral) {
    command.steering = Component(action[settings.size() - 1], settings.steering_range,
                                 settings.clip, single_precision);
  }
  return command;
}

HighwaySimulation::HighwaySimulation(const HighwaySettings& settings, size_t capacity)
    : traffic(capacity),
      settings_(settings),
      ego_speed_range_(settings.action.speed_range.value_or(NumberRange{-kMaxSpeed, kMaxSpeed})),
      frames_(FloorDivide(settings.simulation_frequency, settings.policy_frequency)),
      dt_(1 / settings.simulation_frequency),
      neighbours_(capacity) {}

void HighwaySimulation::Reset(uint64_t seed, uint64_t episode) {
  CreateTraffic(settings_, seed, episode, traffic);
  time = 0;
}

void HighwaySimulation::Step(const HighwayCommand& command) {
  time += 1 / settings_.policy_frequency;
  if (frames_ == 0) return;
  traffic.acceleration[kEgo] = command.acceleration;
  traffic.steering[kEgo] = command.steering;
  for (int frame = 0; frame < frames_; ++frame) Advance();
}

void HighwaySimulation::Advance() {
  neighbours_.Update(traffic, settings_.lanes_count);
  Drive(traffic, neighbours_, settings_.lanes_count);
  Move(traffic, settings_.lanes_count, ego_speed_range_, dt_);
  Collide(traffic, settings_.others_check_collisions, dt_);
}

HighwayOutcome HighwaySimulation::Judge() const {
  const Traffic& t = traffic;
  const HighwaySettings& s = settings_;
  HighwayOutcome outcome;
  outcome.crashed = t.crashed[kEgo] != 0;
  outcome.on_road = OnLane(t.x[kEgo], t.y[kEgo], t.lane[kEgo], 0);
  outcome.right_lane = t.lane[kEgo] / static_cast<double>(std::max(s.lanes_count - 1, 1));
  const NumberRange& range = s.reward_speed_range;
  const double forward = t.speed[kEgo] * t.cos_heading[kEgo];
  outcome.high_speed = std::clamp((forward - range.low) / (range.high - range.low), 0.0, 1.0);
  double reward = s.collision_reward * outcome.crashed + s.right_lane_reward * outcome.right_lane +
                  s.high_speed_reward * outcome.high_speed + s.on_road_reward * outcome.on_road;
  if (s.normalize_reward) {
    reward = (reward - s.collision_reward) /
             (s.high_speed_reward + s.right_lane_reward - s.collision_reward);
  }
  outcome.reward = reward * outcome.on_road;
  outcome.terminated = outcome.crashed || (s.offroad_terminal && !outcome.on_road);
  return outcome;
}

}  // namespace b4mrl
