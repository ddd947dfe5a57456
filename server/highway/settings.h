// The settings of the highway task under highway-env's names, checked where they are filled in
// (server/environments/highway_config.h). The defaults are highway-fast-v0's with continuous
// actions; units are metres, seconds, radians. Immutable while a simulation uses them.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

namespace b4mrl {

// Cars, the ego included: a lane's record (limits::kLaneBufferBytes) holds no more.
inline constexpr size_t kMaxVehicles = 128;
inline constexpr size_t kMaxRoadLanes = 16;

struct NumberRange {
  double low = 0;
  double high = 0;
};

struct HighwayActionSettings {
  bool longitudinal = true;  // the throttle is a component
  bool lateral = true;       // the steering is a component, after the throttle
  bool clip = true;          // clips components to [-1, 1] before they are mapped
  NumberRange acceleration_range = {-5, 5};
  NumberRange steering_range = {-0.78539816339744828, 0.78539816339744828};  // pi/4
  std::optional<NumberRange> speed_range;                                    // of the ego, m/s

  size_t size() const { return size_t{longitudinal} + size_t{lateral}; }
};

enum class HighwayFeature {
  kPresence,
  kX,
  kY,
  kVx,
  kVy,
  kHeading,
  kCosHeading,
  kSinHeading,
  kCosDestination,  // this road has no destination: 0
  kSinDestination,
  kLongitudinalOffset,
  kLateralOffset,
  kAngularOffset,
};

struct HighwayObservationSettings {
  struct Column {
    HighwayFeature feature;
    std::optional<NumberRange> range;  // mapped to [-1, 1]; none: not mapped
  };
  std::vector<Column> columns = {{HighwayFeature::kPresence, {}},
                                 {HighwayFeature::kX, NumberRange{-200, 200}},
                                 {HighwayFeature::kY, NumberRange{-12, 12}},
                                 {HighwayFeature::kVx, NumberRange{-80, 80}},
                                 {HighwayFeature::kVy, NumberRange{-80, 80}}};
  size_t rows = 5;  // the ego's included
  bool absolute = false;
  bool sorted = true;  // by distance along the road; else in the order of creation
  bool clip = true;    // clips columns with a range to [-1, 1]
  bool see_behind = false;

  size_t size() const { return rows * columns.size(); }
};

struct HighwaySettings {
  double simulation_frequency = 5;  // Hz
  double policy_frequency = 1;      // Hz
  int lanes_count = 3;
  size_t vehicles_count = 20;  // the ego not counted
  // The largest number of vehicles_count where each episode of a lane has another one; none: all
  // episodes have the same.
  std::optional<size_t> most_vehicles;
  double duration = 30;
  double ego_spacing = 1.5;
  double vehicles_density = 1;
  std::optional<int> initial_lane_id;  // of the ego; none: random
  double collision_reward = -1;
  double right_lane_reward = 0.1;
  double high_speed_reward = 0.4;
  double on_road_reward = 0;
  NumberRange reward_speed_range = {20, 30};
  bool normalize_reward = true;
  bool offroad_terminal = false;
  bool others_check_collisions = false;  // highway-v0: true
  HighwayActionSettings action;
  HighwayObservationSettings observation;
};

}  // namespace b4mrl
