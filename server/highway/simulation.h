// The simulator of the highway task: an independent double-precision implementation of highway-env
// 1.12's highway-v0 and highway-fast-v0 with continuous control of one car. Trajectories agree with
// highway-env's to rounding (NumPy's sine and cosine there, the C library's here), as
// tests/server/highway shows on recordings.
//
// One control step is floor(simulation_frequency / policy_frequency) frames. In a frame all drivers
// decide, then all cars move, then collisions are found. A step after a crash or the end of the
// time follows the same rules. No memory is taken after construction. One thread.
#pragma once

#include <cstdint>
#include <span>

#include "server/highway/neighbours.h"
#include "server/highway/settings.h"
#include "server/highway/traffic.h"

namespace b4mrl {

// The ego's command: acceleration in m/s2, steering angle in rad.
struct HighwayCommand {
  double acceleration = 0;
  double steering = 0;
};

// The ego's command for an action of settings.size() numbers, throttle before steering. NumPy
// computes in the action's own precision: with `single_precision` every operation is rounded to
// float32, as for a float32 array.
HighwayCommand MapAction(const HighwayActionSettings& settings, std::span<const double> action,
                         bool single_precision);

// highway-env's components of the reward, the reward itself, and whether the episode terminates.
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

  // Starts an episode: CreateTraffic, at time 0.
  void Reset(uint64_t seed, uint64_t episode);
  void Step(const HighwayCommand& command);
  // One frame of a step; the ego keeps its command.
  void Advance();

  HighwayOutcome Judge() const;
  bool TimeIsOver() const { return time >= settings_.duration; }

  // Callers may set `traffic`, with at least the ego, and `time` between steps.
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
