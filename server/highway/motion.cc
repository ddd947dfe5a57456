#include "server/highway/motion.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "server/highway/road.h"

namespace b4mrl {
namespace {

constexpr NumberRange kSpeedRange = {-kMaxSpeed, kMaxSpeed};

// Bounds the stored command of car `i`, which keeps the bounded numbers until a new command comes.
void BoundCommand(Traffic& t, int i, const NumberRange& speed_range) {
  if (t.crashed[i]) {
    t.steering[i] = 0;
    t.acceleration[i] = -1.0 * t.speed[i];
  }
  if (t.speed[i] > speed_range.high) {
    t.acceleration[i] = std::min(t.acceleration[i], speed_range.high - t.speed[i]);
  } else if (t.speed[i] < speed_range.low) {
    t.acceleration[i] = std::max(t.acceleration[i], speed_range.low - t.speed[i]);
  }
}

void MoveOne(Traffic& t, int i, double dt) {
  const double v = t.speed[i];
  double dx, dy;
  double turn = 0;
  if (t.steering[i] == 0) {  // most cars; both branches give equal numbers
    dx = v * t.cos_heading[i] * dt;
    dy = v * t.sin_heading[i] * dt;
  } else {
    const double slip = std::atan(0.5 * std::tan(t.steering[i]));
    const double course = t.heading[i] + slip;
    dx = v * std::cos(course) * dt;
    dy = v * std::sin(course) * dt;
    turn = v * std::sin(slip) / (kVehicleLength / 2) * dt;
  }
  t.x[i] += dx;
  t.y[i] += dy;
  if (t.impact_pending[i]) {
    t.x[i] += t.impact_x[i];
    t.y[i] += t.impact_y[i];
    t.crashed[i] = 1;
    t.impact_pending[i] = 0;
    t.impact_x[i] = 0;
    t.impact_y[i] = 0;
  }
  if (turn != 0) {
    t.heading[i] += turn;
    t.Turn(i);
  }
  t.speed[i] += t.acceleration[i] * dt;
}

struct Point {
  double x, y;
};
using Corners = std::array<Point, 4>;

double Dot(const Point& a, const Point& b) { return a.x * b.x + a.y * b.y; }

Corners CornersOf(const Traffic& t, int i) {
  constexpr double kHalfLength = kVehicleLength / 2;
  constexpr double kHalfWidth = kVehicleWidth / 2;
  static constexpr Corners kBody = {{{-kHalfLength, -kHalfWidth},
                                     {-kHalfLength, kHalfWidth},
                                     {kHalfLength, kHalfWidth},
                                     {kHalfLength, -kHalfWidth}}};
  const double c = t.cos_heading[i];
  const double s = t.sin_heading[i];
  Corners corners;
  for (size_t k = 0; k < corners.size(); ++k) {
    corners[k].x = c * kBody[k].x + -s * kBody[k].y + t.x[i];
    corners[k].y = s * kBody[k].x + c * kBody[k].y + t.y[i];
  }
  return corners;
}

Point Mean(const Corners& c) {
  return {(c[0].x + c[1].x + c[2].x + c[3].x) / 4, (c[0].y + c[1].y + c[2].y + c[3].y) / 4};
}

NumberRange Project(const Corners& corners, const Point& axis) {
  double low = Dot(corners[0], axis);
  double high = low;
  for (size_t k = 1; k < corners.size(); ++k) {
    const double projection = Dot(corners[k], axis);
    low = std::min(low, projection);
    high = std::max(high, projection);
  }
  return {low, high};
}

// The gap between two intervals; negative when they overlap.
double Distance(const NumberRange& a, const NumberRange& b) {
  return a.low < b.low ? b.low - a.high : a.low - b.high;
}

struct Contact {
  bool now = true;
  bool soon = true;
  Point push = {0, 0};  // m; would separate the first car from the second
};

// `sweep`: how far, in m, the first car moves relative to the second within the frame.
Contact FindContact(const Corners& a, const Corners& b, const Point& sweep) {
  Contact contact;
  double least = std::numeric_limits<double>::infinity();
  Point best = {0, 0};
  const Point mean_a = Mean(a);
  const Point mean_b = Mean(b);
  const Point apart = {mean_a.x - mean_b.x, mean_a.y - mean_b.y};
  for (const Corners* polygon : {&a, &b}) {
    for (size_t k = 0; k < 4; ++k) {
      const Point& p = (*polygon)[k];
      const Point& q = (*polygon)[(k + 1) % 4];
      Point normal = {-q.y + p.y, q.x - p.x};
      const double length = std::sqrt(Dot(normal, normal));
      normal = {normal.x / length, normal.y / length};
      NumberRange of_a = Project(a, normal);
      const NumberRange of_b = Project(b, normal);
      if (Distance(of_a, of_b) > 0) contact.now = false;
      const double shift = Dot(normal, sweep);
      (shift < 0 ? of_a.low : of_a.high) += shift;
      const double distance = Distance(of_a, of_b);
      if (distance > 0) contact.soon = false;
      if (!contact.now && !contact.soon) return contact;
      if (std::abs(distance) < least) {
        least = std::abs(distance);
        best = Dot(apart, normal) > 0 ? normal : Point{-normal.x, -normal.y};
      }
    }
  }
  contact.push = {least * best.x, least * best.y};
  return contact;
}

void CollidePair(Traffic& t, int a, int b, double dt) {
  const auto displacement = [&](int i) {
    return Point{t.speed[i] * t.cos_heading[i] * dt, t.speed[i] * t.sin_heading[i] * dt};
  };
  const Point of_a = displacement(a);
  const Point of_b = displacement(b);
  const Contact contact =
      FindContact(CornersOf(t, a), CornersOf(t, b), {of_a.x - of_b.x, of_a.y - of_b.y});
  if (contact.soon) {
    t.impact_x[a] = contact.push.x / 2;
    t.impact_y[a] = contact.push.y / 2;
    t.impact_x[b] = -contact.push.x / 2;
    t.impact_y[b] = -contact.push.y / 2;
    t.impact_pending[a] = t.impact_pending[b] = 1;
  }
  if (contact.now) t.crashed[a] = t.crashed[b] = 1;
}

}  // namespace

void Move(Traffic& t, int lanes, const NumberRange& ego_speed_range, double dt) {
  for (int i = 0; i < t.count; ++i) {
    if (i != kEgo) t.timer[i] += dt;
    BoundCommand(t, i, i == kEgo ? ego_speed_range : kSpeedRange);
    MoveOne(t, i, dt);
    t.lane[i] = ClosestLane(t.x[i], t.y[i], t.heading[i], lanes, t.lane[i]);
  }
}

void Collide(Traffic& t, bool others_collide, double dt) {
  const int firsts = others_collide ? t.count : 1;
  for (int a = 0; a < firsts; ++a) {
    // Cars whose centres are more than `reach` m apart cannot touch.
    const double reach = kVehicleDiagonal + t.speed[a] * dt;
    if (reach < 0) continue;
    // Most pairs are told apart by squared distances; close to `reach` the rounded root decides.
    const double clearly_apart = reach * reach * (1 + 1e-9);
    for (int b = a + 1; b < t.count; ++b) {
      const double dx = t.x[b] - t.x[a];
      const double dy = t.y[b] - t.y[a];
      const double squares = dx * dx + dy * dy;
      if (squares > clearly_apart || std::sqrt(squares) > reach) continue;
      CollidePair(t, a, b, dt);
    }
  }
}

}  // namespace b4mrl
