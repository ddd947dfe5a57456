// The cars on the road, as one array a quantity. Car 0 is the ego; the order never changes and
// decides ties. Memory is taken once, at construction. One thread.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace b4mrl {

inline constexpr int kEgo = 0;
inline constexpr int kNoVehicle = -1;
inline constexpr int kNoLane = -1;  // the ego has no target lane

// The numbers of a row, which describes a car for users, in their order. Traffic's members have the
// same names and say what each of them is.
enum VehicleColumn : size_t {
  kColumnX,
  kColumnY,
  kColumnHeading,
  kColumnSpeed,
  kColumnLane,
  kColumnTargetLane,
  kColumnTimer,
  kColumnCrashed,
  kColumnImpactPending,
  kColumnImpactX,
  kColumnImpactY,
  kColumnSteering,
  kColumnAcceleration,
  kColumnTargetSpeed,
  kColumnDelta,
};
inline constexpr size_t kVehicleColumns = kColumnDelta + 1;

struct Traffic {
  explicit Traffic(size_t capacity);

  // Number of doubles that Save writes: the count, then each column, of `capacity` numbers.
  static size_t StateSize(size_t capacity) { return 1 + kVehicleColumns * capacity; }
  void Save(std::span<double> state) const;
  // Accepts any numbers: counts, lanes and flags are brought into range, so that no state can make
  // the simulation reach beyond its arrays.
  void Load(std::span<const double> state, int lanes);

  // `row` has kVehicleColumns numbers. Set brings lanes and flags into range as Load does.
  void Get(int vehicle, std::span<double> row) const;
  void Set(int vehicle, std::span<const double> row, int lanes);
  // Removes all cars. Numbers beyond `count` are always 0.
  void Clear();
  // Recomputes cos_heading and sin_heading from heading.
  void Turn(int vehicle);

  size_t capacity() const { return x.size(); }
  bool AllFinite() const;

  int count = 0;
  std::vector<double> x, y;                // of the centre, m
  std::vector<double> heading;             // rad, 0 along the road; never wrapped
  std::vector<double> speed;               // m/s along the heading; negative: backwards
  std::vector<int> lane;                   // the lane that the car counts to (ClosestLane)
  std::vector<int> target_lane;            // kNoLane for the ego
  std::vector<double> timer;               // s since the driver last considered a lane change
  std::vector<int> crashed;                // 0 or 1
  std::vector<int> impact_pending;         // 0 or 1: the impact below is applied by the next motion
  std::vector<double> impact_x, impact_y;  // m, displacement by the pending impact
  std::vector<double> steering;            // rad, the command in force
  std::vector<double> acceleration;        // m/s2, the command in force
  std::vector<double> target_speed;        // m/s; unused by the ego
  std::vector<double> delta;               // exponent of the driver's model; unused by the ego

  std::vector<double> cos_heading, sin_heading;  // derived from heading
};

}  // namespace b4mrl
