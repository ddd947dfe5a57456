#include "server/highway/driver.h"

#include <algorithm>
#include <cmath>

#include "server/highway/road.h"

namespace b4mrl {
namespace {

// Intelligent driver model along the road; accelerations in m/s2.
constexpr double kMaxAcceleration = 6;  // m/s2, in both directions
constexpr double kComfortAcceleration = 3;
constexpr double kComfortDeceleration = 5;
constexpr double kJamDistance = 5 + kVehicleLength;  // m between centres
constexpr double kTimeGap = 1.5;                     // s
const double kTwiceComfort = 2 * std::sqrt(kComfortAcceleration * kComfortDeceleration);

// MOBIL lane changes.
constexpr double kThinkEvery = 1.0;         // s
constexpr double kMinThinkingSpeed = 1.0;   // m/s
constexpr double kMaxImposedBraking = 2.0;  // m/s2
constexpr double kMinGain = 0.2;            // m/s2

// Steering controller; angles in rad.
constexpr double kLateralGain = 1 / 0.6;  // 1/s
constexpr double kHeadingGain = 1 / 0.2;  // 1/s
constexpr double kMaxSteering = kPi / 3;
constexpr double kMaxHeadingCommand = kPi / 4;

double NotZero(double value) {
  if (std::abs(value) > 0.01) return value;
  return value >= 0 ? 0.01 : -0.01;
}

// The distance in m, between centres, that `vehicle` would keep from `front`; may be negative.
double DesiredGap(const Traffic& t, int vehicle, int front) {
  const double c = t.cos_heading[vehicle];
  const double s = t.sin_heading[vehicle];
  const double v = t.speed[vehicle];
  const double vf = t.speed[front];
  const double approach =
      (v * c - vf * t.cos_heading[front]) * c + (v * s - vf * t.sin_heading[front]) * s;
  return kJamDistance + v * kTimeGap + v * approach / kTwiceComfort;
}

class LaneChoice {
 public:
  // `free_acceleration`: FreeAcceleration of `vehicle`, m/s2.
  LaneChoice(Traffic& traffic, const Neighbours& neighbours, int lanes, int vehicle,
             double free_acceleration)
      : t_(traffic),
        neighbours_(neighbours),
        lanes_(lanes),
        vehicle_(vehicle),
        free_(free_acceleration) {}

  void Decide() {
    if (t_.lane[vehicle_] != t_.target_lane[vehicle_]) return GiveWay();
    if (!(t_.timer[vehicle_] > kThinkEvery)) return;
    t_.timer[vehicle_] = 0;
    const int lane = t_.lane[vehicle_];
    if (lane > 0) Consider(lane - 1);
    if (lane < lanes_ - 1) Consider(lane + 1);
  }

 private:
  // Gives up a lane change under way when another car close ahead heads for the same lane.
  void GiveWay() {
    const int target = t_.target_lane[vehicle_];
    for (int other = kEgo + 1; other < t_.count; ++other) {
      if (other == vehicle_ || t_.lane[other] == target || t_.target_lane[other] != target) {
        continue;
      }
      const double distance = t_.x[other] - t_.x[vehicle_];
      if (0 < distance && distance < DesiredGap(t_, vehicle_, other)) {
        t_.target_lane[vehicle_] = t_.lane[vehicle_];
        return;
      }
    }
  }

  void Consider(int lane) {
    if (!Reachable(t_.x[vehicle_], t_.y[vehicle_], lane)) return;
    if (std::abs(t_.speed[vehicle_]) < kMinThinkingSpeed) return;
    if (IsWorthIt(lane)) t_.target_lane[vehicle_] = lane;
  }

  bool IsWorthIt(int lane) const {
    const int follower = neighbours_.Rear(vehicle_, lane);
    if (follower != kNoVehicle) {
      const double imposed =
          FreeAcceleration(t_, follower, t_.delta[vehicle_]) - Interaction(t_, follower, vehicle_);
      if (imposed < -kMaxImposedBraking) return false;
    }
    const double gain = Behind(neighbours_.Front(vehicle_, lane)) -
                        Behind(neighbours_.Front(vehicle_, t_.lane[vehicle_]));
    return !(gain < kMinGain);
  }

  double Behind(int front) const {
    return front == kNoVehicle ? free_ : free_ - Interaction(t_, vehicle_, front);
  }

  Traffic& t_;
  const Neighbours& neighbours_;
  int lanes_;
  int vehicle_;
  double free_;
};

}  // namespace

double FreeAcceleration(const Traffic& t, int vehicle, double delta) {
  const double wanted = vehicle == kEgo ? 0 : std::clamp(t.target_speed[vehicle], 0.0, kSpeedLimit);
  const double ratio = std::max(t.speed[vehicle], 0.0) / std::abs(NotZero(wanted));
  return kComfortAcceleration * (1 - std::pow(ratio, delta));
}

double Interaction(const Traffic& t, int vehicle, int front) {
  const double ratio = DesiredGap(t, vehicle, front) / NotZero(t.x[front] - t.x[vehicle]);
  return kComfortAcceleration * (ratio * ratio);
}

double SteeringTowards(const Traffic& t, int vehicle, int lane) {
  const double heading = t.heading[vehicle];
  const double offset = t.y[vehicle] - LaneCentre(lane);
  if (offset == 0 && heading == 0) return 0;  // as the lines below would give
  const double speed = NotZero(t.speed[vehicle]);
  const double command = std::asin(std::clamp(-kLateralGain * offset / speed, -1.0, 1.0));
  const double wanted = std::clamp(command, -kMaxHeadingCommand, kMaxHeadingCommand);
  const double rate = kHeadingGain * WrapAngle(wanted - heading);
  const double slip = std::asin(std::clamp(kVehicleLength / 2 / speed * rate, -1.0, 1.0));
  return std::clamp(std::atan(2 * std::tan(slip)), -kMaxSteering, kMaxSteering);
}

void Drive(Traffic& t, const Neighbours& neighbours, int lanes) {
  for (int vehicle = kEgo + 1; vehicle < t.count; ++vehicle) {
    if (t.crashed[vehicle]) continue;
    const double free = FreeAcceleration(t, vehicle, t.delta[vehicle]);
    LaneChoice(t, neighbours, lanes, vehicle, free).Decide();
    t.steering[vehicle] = SteeringTowards(t, vehicle, t.target_lane[vehicle]);
    const auto behind = [&](int lane) {
      const int front = neighbours.Front(vehicle, lane);
      return front == kNoVehicle ? free : free - Interaction(t, vehicle, front);
    };
    double acceleration = behind(t.lane[vehicle]);
    if (t.lane[vehicle] != t.target_lane[vehicle]) {
      acceleration = std::min(acceleration, behind(t.target_lane[vehicle]));
    }
    t.acceleration[vehicle] = std::clamp(acceleration, -kMaxAcceleration, kMaxAcceleration);
  }
}

}  // namespace b4mrl
