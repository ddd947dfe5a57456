// Pictures of Highway: what stands where, and in which colour.
#include "server/render/painter/plan_renderer.h"

#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <vector>

#include "server/environments/highway_plan.h"
#include "server/highway/traffic.h"

namespace b4mrl {
namespace {

constexpr uint32_t kWidth = 600;
constexpr uint32_t kHeight = 150;
constexpr double kPixelsPerMetre = 5.5;
constexpr Colour kGreen = {50, 200, 0};
constexpr Colour kBlue = {100, 200, 255};
constexpr Colour kRed = {255, 100, 100};
constexpr Colour kAsphalt = {100, 100, 100};

using Picture = std::vector<std::byte>;

Picture Draw(const PlanView& plan, uint32_t width = kWidth, uint32_t height = kHeight) {
  Picture picture(size_t{3} * width * height);
  REQUIRE(DrawPlanWithCairo(plan, width, height, picture).ok());
  return picture;
}

Colour At(const Picture& picture, double x, double y, uint32_t width = kWidth) {
  const size_t at = 3 * (static_cast<size_t>(y) * width + static_cast<size_t>(x));
  return {static_cast<uint8_t>(picture[at]), static_cast<uint8_t>(picture[at + 1]),
          static_cast<uint8_t>(picture[at + 2])};
}

struct Car {
  double x, y, heading = 0;
  bool crashed = false;
};

std::vector<double> Rows(const std::vector<Car>& cars) {
  std::vector<double> rows;
  for (const Car& car : cars) {
    std::array<double, kVehicleColumns> row{};
    row[kColumnX] = car.x;
    row[kColumnY] = car.y;
    row[kColumnHeading] = car.heading;
    row[kColumnCrashed] = car.crashed ? 1 : 0;
    rows.insert(rows.end(), row.begin(), row.end());
  }
  return rows;
}

// The pixel of a point `ahead` and `right` of the ego, in metres.
Colour NearEgo(const Picture& picture, double ahead, double right) {
  return At(picture, 0.3 * kWidth + ahead * kPixelsPerMetre,
            0.5 * kHeight + right * kPixelsPerMetre);
}

TEST_CASE("A plan's polygons stand where its scale and anchor put them") {
  PlanView plan;
  plan.background = {1, 2, 3};
  plan.origin = {100, 50};
  plan.anchor = {0.5, 0.5};
  plan.metres_wide = 10;
  const Colour colour = {200, 100, 50};
  plan.polygons = {{{{101, 51}, {103, 51}, {103, 52}, {101, 52}}, colour}};
  const Picture picture = Draw(plan, 100, 40);  // 10 pixels a metre
  CHECK(At(picture, 61, 31, 100) == colour);
  CHECK(At(picture, 78, 38, 100) == colour);
  CHECK(At(picture, 58, 31, 100) == plan.background);
  CHECK(At(picture, 61, 28, 100) == plan.background);
  CHECK(At(picture, 82, 31, 100) == plan.background);
}

TEST_CASE("Highway's ego stands at three tenths of the width and the others around it") {
  const Picture picture =
      Draw(HighwayPlan(3, Rows({{200, 4}, {220, 8}, {190, 0}})), kWidth, kHeight);
  CHECK(NearEgo(picture, 0, 0) == kGreen);
  CHECK(NearEgo(picture, 20, 4) == kBlue);
  CHECK(NearEgo(picture, -10, -4) == kBlue);
  CHECK(NearEgo(picture, 40, 0) == kAsphalt);
  // The road ends half a lane beyond its outer lanes' centres.
  CHECK(NearEgo(picture, 40, 5) == kAsphalt);
  CHECK_FALSE(NearEgo(picture, 40, 7) == kAsphalt);
  CHECK_FALSE(NearEgo(picture, 40, -7) == kAsphalt);
}

TEST_CASE("A car in a Highway picture is turned by its heading") {
  const double quarter = std::acos(-1.0) / 2;
  const Picture along = Draw(HighwayPlan(3, Rows({{0, 4}, {30, 4}})));
  const Picture across = Draw(HighwayPlan(3, Rows({{0, 4}, {30, 4, quarter}})));
  CHECK(NearEgo(along, 32, 0) == kBlue);
  CHECK_FALSE(NearEgo(across, 32, 0) == kBlue);
  CHECK(NearEgo(across, 30, 2) == kBlue);
  CHECK_FALSE(NearEgo(along, 30, 2) == kBlue);
}

TEST_CASE("A crashed car is red in a Highway picture") {
  const Picture picture = Draw(HighwayPlan(3, Rows({{0, 0, 0, true}, {15, 0, 0, true}, {40, 4}})));
  CHECK(NearEgo(picture, 0, 0) == kRed);
  CHECK(NearEgo(picture, 15, 0) == kRed);
  CHECK(NearEgo(picture, 40, 4) == kBlue);
}

TEST_CASE("Absurd positions give a Highway picture, too") {
  for (const double far : {1e9, -1e17, 1e300}) {
    INFO(far);
    CHECK(Draw(HighwayPlan(3, Rows({{far, 4}, {0, 4}}))) != Picture());
    CHECK(Draw(HighwayPlan(3, Rows({{0, far}, {0, 4}}))) != Picture());
    const Picture alone = Draw(HighwayPlan(3, Rows({{0, 4}})));
    CHECK(Draw(HighwayPlan(3, Rows({{0, 4}, {far, far}}))) == alone);
  }
}

}  // namespace
}  // namespace b4mrl
