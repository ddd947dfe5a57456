// The road: `lanes` parallel straight lanes of 10 km, x along it, y to the right, lane i centred on
// y = 4 i. Also the sizes and limits that all cars have in common. Lengths in metres, angles in
// radians.
#pragma once

#include <algorithm>
#include <cmath>

namespace b4mrl {

inline constexpr double kPi = 3.14159265358979323846;
inline constexpr double kLaneWidth = 4;
inline constexpr double kRoadLength = 10000;
inline constexpr double kSpeedLimit = 30;  // m/s
inline constexpr double kVehicleLength = 5;
inline constexpr double kVehicleWidth = 2;
inline constexpr double kMaxSpeed = 40;  // m/s; -kMaxSpeed backwards
inline const double kVehicleDiagonal = std::sqrt(29.0);

inline double LaneCentre(int lane) { return kLaneWidth * lane; }

// Wraps an angle to [-pi, pi), by the same rounding steps as Python's floored modulo.
inline double WrapAngle(double angle) {
  constexpr double kTurn = 2 * kPi;
  double shifted = angle + kPi;
  if (!(shifted >= 0 && shifted < kTurn)) {
    shifted = std::fmod(shifted, kTurn);
    if (shifted < 0) shifted += kTurn;
  }
  return shifted - kPi;
}

// Whether `x` lies on the road or at most one car's length beyond either end of the road.
inline bool AlongRoad(double x) {
  return (x >= -kVehicleLength) & (x < kRoadLength + kVehicleLength);
}

inline bool OnLane(double x, double y, int lane, double margin) {
  // Computed without branches, because this is called for every car and lane in every frame.
  return (std::abs(y - LaneCentre(lane)) <= kLaneWidth / 2 + margin) & AlongRoad(x);
}

inline bool Reachable(double x, double y, int lane) {
  return std::abs(y - LaneCentre(lane)) <= 2 * kLaneWidth && x >= 0 &&
         x < kRoadLength + kVehicleLength;
}

// The lane that a car counts to: the nearest lane, the leftmost of equally near ones. The terms
// added to the lateral distance are the same for all lanes, but decide ties after rounding.
// `before`: the lane of the car a frame ago.
inline int ClosestLane(double x, double y, double heading, int lanes, int before) {
  const double behind = std::max(0.0 - x, 0.0);
  const double beyond = std::max(x - kRoadLength, 0.0);
  // A car nearer than half a lane, with room for any rounding, keeps its lane without a search.
  constexpr double kClearlyNearest = kLaneWidth / 2 - 0.01;
  if (std::abs(y - LaneCentre(before)) < kClearlyNearest && behind + beyond < 1e6) return before;
  const double angle = std::abs(WrapAngle(heading));
  int closest = 0;
  double best = 0;
  for (int lane = 0; lane < lanes; ++lane) {
    const double distance = std::abs(y - LaneCentre(lane)) + beyond + behind + angle;
    if (lane > 0 && !(distance < best)) continue;
    best = distance;
    closest = lane;
  }
  return closest;
}

}  // namespace b4mrl
