// What bounds a car's command while it moves.
#include "server/highway/motion.h"

#include <catch2/catch.hpp>

namespace b4mrl {
namespace {

// After one frame: the acceleration of a car with this speed and command, and the ego's range.
double AccelerationOf(int car, double speed, double command, const NumberRange& ego_range) {
  Traffic traffic(2);
  traffic.count = 2;
  traffic.x[1] = 100;
  traffic.speed[car] = speed;
  traffic.acceleration[car] = command;
  Move(traffic, 3, ego_range, 1.0 / 15);
  return traffic.acceleration[car];
}

TEST_CASE("A car beyond its range of speeds is commanded back into it") {
  const NumberRange ego_range = {10, 30};
  CHECK(AccelerationOf(kEgo, 8, -5, ego_range) == 2);  // up to 10 m/s
  CHECK(AccelerationOf(kEgo, 8, 4, ego_range) == 4);   // which is more already
  CHECK(AccelerationOf(kEgo, 33, 5, ego_range) == -3);
  CHECK(AccelerationOf(kEgo, 20, -5, ego_range) == -5);
  // Others have -40 to 40 m/s, whatever the ego's range is.
  CHECK(AccelerationOf(1, -42, -5, ego_range) == 2);
  CHECK(AccelerationOf(1, 42, 5, ego_range) == -2);
  CHECK(AccelerationOf(1, 8, -5, ego_range) == -5);
}

}  // namespace
}  // namespace b4mrl
