// The cars' rows: which number stands where.
#include "server/highway/traffic.h"

#include <array>
#include <catch2/catch.hpp>

namespace b4mrl {
namespace {

TEST_CASE("A car's row has each quantity in its own column") {
  Traffic traffic(2);
  traffic.count = 2;
  constexpr int kOther = 1;
  traffic.x[kOther] = 1;
  traffic.y[kOther] = 2;
  traffic.heading[kOther] = 3;
  traffic.speed[kOther] = 4;
  traffic.lane[kOther] = 5;
  traffic.target_lane[kOther] = 6;
  traffic.timer[kOther] = 7;
  traffic.crashed[kOther] = 8;
  traffic.impact_pending[kOther] = 9;
  traffic.impact_x[kOther] = 10;
  traffic.impact_y[kOther] = 11;
  traffic.steering[kOther] = 12;
  traffic.acceleration[kOther] = 13;
  traffic.target_speed[kOther] = 14;
  traffic.delta[kOther] = 15;
  std::array<double, kVehicleColumns> row{};
  traffic.Get(kOther, row);
  CHECK(row[kColumnX] == 1);
  CHECK(row[kColumnY] == 2);
  CHECK(row[kColumnHeading] == 3);
  CHECK(row[kColumnSpeed] == 4);
  CHECK(row[kColumnLane] == 5);
  CHECK(row[kColumnTargetLane] == 6);
  CHECK(row[kColumnTimer] == 7);
  CHECK(row[kColumnCrashed] == 8);
  CHECK(row[kColumnImpactPending] == 9);
  CHECK(row[kColumnImpactX] == 10);
  CHECK(row[kColumnImpactY] == 11);
  CHECK(row[kColumnSteering] == 12);
  CHECK(row[kColumnAcceleration] == 13);
  CHECK(row[kColumnTargetSpeed] == 14);
  CHECK(row[kColumnDelta] == 15);
}

}  // namespace
}  // namespace b4mrl
