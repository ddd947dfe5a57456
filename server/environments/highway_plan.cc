#include "server/environments/highway_plan.h"

#include <cmath>

#include "server/highway/road.h"
#include "server/highway/traffic.h"

namespace b4mrl {
namespace {

constexpr double kMetresWide = 600 / 5.5;
constexpr PlanPoint kEgoAnchor = {0.3, 0.5};

constexpr double kStripeWidth = 0.3;
constexpr double kStripeLength = 3;
constexpr double kStripePeriod = 13;  // m, a stripe and a gap
constexpr double kOutline = 0.2;

constexpr Colour kVerge = {88, 116, 84};
constexpr Colour kAsphalt = {100, 100, 100};
constexpr Colour kMarking = {245, 245, 245};
constexpr Colour kEdge = {50, 50, 50};
constexpr Colour kWindscreen = {45, 60, 75};
constexpr Colour kEgo = {50, 200, 0};
constexpr Colour kOther = {100, 200, 255};
constexpr Colour kCrashed = {255, 100, 100};

struct Box {
  double left, right, top, bottom;
};

PlanPolygon Rectangle(const Box& box, Colour colour) {
  return {
      {{box.left, box.top}, {box.right, box.top}, {box.right, box.bottom}, {box.left, box.bottom}},
      colour};
}

// `box` in the car's own frame: x forward from its centre.
PlanPolygon CarPart(std::span<const double> car, const Box& box, Colour colour) {
  const double cosine = std::cos(car[kColumnHeading]);
  const double sine = std::sin(car[kColumnHeading]);
  PlanPolygon polygon = Rectangle(box, colour);
  for (PlanPoint& corner : polygon.corners) {
    corner = {car[kColumnX] + cosine * corner.x - sine * corner.y,
              car[kColumnY] + sine * corner.x + cosine * corner.y};
  }
  return polygon;
}

void AddRoad(uint32_t lanes, double left, double right, std::vector<PlanPolygon>& polygons) {
  const double top = -kLaneWidth / 2;
  const double bottom = top + kLaneWidth * lanes;
  polygons.push_back(Rectangle({left, right, top, bottom}, kAsphalt));
  for (uint32_t line = 0; line <= lanes; ++line) {
    const double y = top + kLaneWidth * line;
    const auto stripe = [&](double from, double to) {
      polygons.push_back(
          Rectangle({from, to, y - kStripeWidth / 2, y + kStripeWidth / 2}, kMarking));
    };
    if (line == 0 || line == lanes) {
      stripe(left, right);
      continue;
    }
    // Stripes are counted, because far from 0 a double is too coarse for x += kStripePeriod to end.
    const double first = std::floor(left / kStripePeriod) * kStripePeriod;
    const int stripes = static_cast<int>(kMetresWide / kStripePeriod) + 2;
    for (int i = 0; i < stripes; ++i) {
      stripe(first + i * kStripePeriod, first + i * kStripePeriod + kStripeLength);
    }
  }
}

void AddCar(std::span<const double> car, bool is_ego, std::vector<PlanPolygon>& polygons) {
  const double front = kVehicleLength / 2;
  const double side = kVehicleWidth / 2;
  const Colour colour = car[kColumnCrashed] != 0 ? kCrashed : is_ego ? kEgo : kOther;
  polygons.push_back(CarPart(car, {-front, front, -side, side}, kEdge));
  polygons.push_back(CarPart(
      car, {-front + kOutline, front - kOutline, -side + kOutline, side - kOutline}, colour));
  polygons.push_back(
      CarPart(car, {0.6, 1.4, -side + 2 * kOutline, side - 2 * kOutline}, kWindscreen));
}

}  // namespace

PlanView HighwayPlan(uint32_t lanes, std::span<const double> vehicles) {
  PlanView plan;
  plan.background = kVerge;
  plan.origin = {vehicles[kColumnX], vehicles[kColumnY]};
  plan.anchor = kEgoAnchor;
  plan.metres_wide = kMetresWide;
  const double left = plan.origin.x - plan.anchor.x * plan.metres_wide;
  const double right = left + plan.metres_wide;
  AddRoad(lanes, left, right, plan.polygons);
  // The ego comes last, over whatever it has hit.
  for (size_t row = vehicles.size() / kVehicleColumns; row-- > 0;) {
    const auto car = vehicles.subspan(row * kVehicleColumns, kVehicleColumns);
    if (car[kColumnX] > left - kVehicleLength && car[kColumnX] < right + kVehicleLength) {
      AddCar(car, row == 0, plan.polygons);
    }
  }
  return plan;
}

}  // namespace b4mrl
