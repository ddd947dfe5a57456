// The highway task without any wire: an independent double-precision implementation of highway-env
// 1.12's highway-v0 and highway-fast-v0 with continuous control of one car. Trajectories agree with
// the original's to rounding (it calls NumPy's sine and cosine, this the C library's), as
// tests/server/highway shows on recordings.
//
// One control step is floor(simulation_frequency / policy_frequency) frames. In a frame all drivers
// decide, then all cars move, then collisions are found. Stepping past an end goes on by the same
// rules. No memory is taken after construction. One thread.
#pragma once

#include <cstdint>
#include <span>

#include "server/highway/neighbours.h"
#include "server/highway/settings.h"
#include "server/highway/traffic.h"

namespace b4mrl {

// Of the ego: acceleration in m/s2, steering in rad.
struct HighwayCommand {
  double acceleration = 0;
  double steering = 0;
};

// An action's command. `action` has settings.size() numbers, throttle before steering. NumPy
// computes in the action's own precision: with `single_precision` every operation is rounded to
// float32, as for a float32 array.
HighwayCommand MapAction(const HighwayActionSettings& settings, std::span<const double> action,
                         bool single_precision);

// highway-env's components of the reward, and what is made of them.
struct HighwayOutcome {
  bool crashed = false;
  bool on_road = false;
  double right_lane = 0;  // 0 (leftmost) to 1
  double high_speed = 0;  // 0 to 1
  double reward = 0;
  bool terminated = false;
};

class HighwaySimulation {
 public:
  // Room for `capacity` cars. `settings` outlives the object.
  HighwaySimulation(const HighwaySettings& settings, size_t capacity);

  // CreateTraffic at time 0.
  void Reset(uint64_t seed, uint64_t episode);
  void Step(const HighwayCommand& command);
  // One frame of a step; the ego keeps its command.
  void Advance();

  HighwayOutcome Judge() const;
  bool TimeIsOver() const { return time >= settings_.duration; }

  // May be set between steps; traffic holds at least the ego.
  Traffic traffic;
  double time = 0;  // of policy steps since the reset, s

 private:
  const HighwaySettings& settings_;
  NumberRange ego_speed_range_;
  int frames_;
  double dt_;
  Neighbours neighbours_;
};

}  // namespace b4mrl
