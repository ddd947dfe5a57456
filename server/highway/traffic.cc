#include "server/highway/traffic.h"

#include <algorithm>
#include <cmath>

namespace b4mrl {
namespace {

// Calls `visit` with each column, in the order of VehicleColumn.
template <typename AnyTraffic, typename Visit>
void ForEachColumn(AnyTraffic& traffic, Visit visit) {
  visit(traffic.x);
  visit(traffic.y);
  visit(traffic.heading);
  visit(traffic.speed);
  visit(traffic.lane);
  visit(traffic.target_lane);
  visit(traffic.timer);
  visit(traffic.crashed);
  visit(traffic.impact_pending);
  visit(traffic.impact_x);
  visit(traffic.impact_y);
  visit(traffic.steering);
  visit(traffic.acceleration);
  visit(traffic.target_speed);
  visit(traffic.delta);
}

// The value truncated to an integer, from -1 to a million; -1 for NaN.
int SafeInteger(double value) {
  constexpr double kLargest = 1e6;
  return value > -1 ? static_cast<int>(std::min(value, kLargest)) : -1;
}

void Assign(double& to, double from) { to = from; }
void Assign(int& to, double from) { to = SafeInteger(from); }

void BringIntoRange(Traffic& traffic, int vehicle, int lanes) {
  traffic.lane[vehicle] = std::clamp(traffic.lane[vehicle], 0, lanes - 1);
  traffic.target_lane[vehicle] =
      vehicle == kEgo ? kNoLane : std::clamp(traffic.target_lane[vehicle], 0, lanes - 1);
  traffic.crashed[vehicle] = traffic.crashed[vehicle] > 0;
  traffic.impact_pending[vehicle] = traffic.impact_pending[vehicle] > 0;
}

}  // namespace

Traffic::Traffic(size_t capacity) {
  ForEachColumn(*this, [capacity](auto& column) { column.resize(capacity); });
  cos_heading.resize(capacity, 1);
  sin_heading.resize(capacity, 0);
}

void Traffic::Save(std::span<double> state) const {
  double* out = state.data();
  *out++ = count;
  ForEachColumn(*this,
                [&out](const auto& column) { out = std::copy(column.begin(), column.end(), out); });
}

void Traffic::Load(std::span<const double> state, int lanes) {
  const double* in = state.data();
  count = std::clamp(SafeInteger(*in++), 1, static_cast<int>(capacity()));
  ForEachColumn(*this, [&in](auto& column) {
    for (auto& value : column) Assign(value, *in++);
  });
  for (int i = 0; i < count; ++i) {
    BringIntoRange(*this, i, lanes);
    Turn(i);
  }
}

void Traffic::Get(int vehicle, std::span<double> row) const {
  double* out = row.data();
  ForEachColumn(*this, [&out, vehicle](const auto& column) { *out++ = column[vehicle]; });
}

void Traffic::Set(int vehicle, std::span<const double> row, int lanes) {
  const double* in = row.data();
  ForEachColumn(*this, [&in, vehicle](auto& column) { Assign(column[vehicle], *in++); });
  BringIntoRange(*this, vehicle, lanes);
  Turn(vehicle);
}

void Traffic::Clear() {
  count = 0;
  ForEachColumn(*this, [](auto& column) { std::ranges::fill(column, 0); });
  std::ranges::fill(cos_heading, 1);
  std::ranges::fill(sin_heading, 0);
}

void Traffic::Turn(int vehicle) {
  const double angle = heading[vehicle];
  const bool straight = angle == 0;  // most cars; cos and sin would say the same
  cos_heading[vehicle] = straight ? 1 : std::cos(angle);
  sin_heading[vehicle] = straight ? 0 : std::sin(angle);
}

bool Traffic::AllFinite() const {
  double sum = 0;  // 0, or NaN after a number that is not finite
  for (int i = 0; i < count; ++i) {
    sum += 0 * x[i] + 0 * y[i] + 0 * heading[i] + 0 * speed[i] + 0 * timer[i] +
           0 * acceleration[i] + 0 * impact_x[i] + 0 * impact_y[i];
  }
  return sum == 0;
}

}  // namespace b4mrl
