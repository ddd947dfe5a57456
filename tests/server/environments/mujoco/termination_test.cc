// What a predicted observation's bounds are: those of MOPO's static termination functions, with
// which its results were made.
#include <limits>
#include <nlohmann/json.hpp>

#include "server/environments/list.h"
#include "tests/server/environments/simulation.h"

namespace b4mrl {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
using Bounds = std::vector<std::tuple<uint32_t, double, double, bool>>;

Bounds BoundsOf(const std::string& environment, const std::string& config = "") {
  Bounds bounds;
  const EnvironmentSpec spec = Take(TryOpen(environment, "", config))->spec();
  for (const DimensionBounds& each : spec.termination.value()) {
    bounds.emplace_back(each.dimension, each.low, each.high, each.inclusive);
  }
  return bounds;
}

TEST_CASE("The termination bounds are those of MOPO's source") {
  CHECK(BoundsOf("HalfCheetah").empty());
  Bounds hopper = {{0, 0.7, kInfinity, false}, {1, -0.2, 0.2, false}};
  for (uint32_t i = 2; i < 11; ++i) hopper.emplace_back(i, -kInfinity, 100, false);
  CHECK(BoundsOf("Hopper") == hopper);
  CHECK(BoundsOf("Walker2d") == Bounds{{0, 0.8, 2, false}, {1, -1, 1, false}});
  CHECK(BoundsOf("Humanoid") == Bounds{{0, 1, 2, true}});
  // As float32, which learners compare in, they are the numbers that the source has.
  CHECK(static_cast<float>(0.7) == 0.7f);
  CHECK(static_cast<float>(0.8) == 0.8f);
  CHECK(static_cast<float>(0.2) == 0.2f);
  CHECK_FALSE(Take(DescribeEnvironment("Highway")).termination.has_value());
}

TEST_CASE("The termination bounds follow the settings") {
  CHECK(BoundsOf("Walker2d", R"({"terminate_when_unhealthy": false})").empty());
  CHECK(BoundsOf("Hopper", R"({"terminate_when_unhealthy": false})").empty());
  CHECK(BoundsOf("Walker2d", R"({"exclude_current_positions_from_observation": false,
                                 "healthy_z_range": [0.5, null]})") ==
        Bounds{{1, 0.5, kInfinity, false}, {2, -1, 1, false}});
  CHECK(BoundsOf("Humanoid", R"({"exclude_current_positions_from_observation": false})") ==
        Bounds{{2, 1, 2, true}});
  CHECK(BoundsOf("Hopper", R"({"healthy_state_range": [-100, 100]})") == BoundsOf("Hopper"));
}

TEST_CASE("Of another range of the Hopper's state, both ends count, for the pitch too") {
  Bounds hopper = {{0, 0.7, kInfinity, false}, {1, -0.2, 0.2, false}};
  for (uint32_t i = 1; i < 11; ++i) hopper.emplace_back(i, -2, 3, false);
  CHECK(BoundsOf("Hopper", R"({"healthy_state_range": [-2, 3]})") == hopper);
  // As the task itself judges: a falling joint, not the torso, ends the episode.
  const auto terminated = [](const char* config) {
    TestLane lane(Take(TryOpen("Hopper", "", config)));
    lane.Reset();
    RequireOk(lane.TrySetState({{"qpos", {0, 1.25, 0, 0, -2.5, 0}}, {"qvel", {0, 0, 0, 0, 0, 0}}}));
    lane.Step(std::vector<double>(3, 0.0));
    return lane.header().terminated == 1;
  };
  const char* const anywhere =
      R"({"healthy_z_range": [null, null], "healthy_angle_range": [null, null],
          "healthy_state_range": [-2, 3]})";
  CHECK(terminated(anywhere));
  CHECK_FALSE(terminated(R"({"healthy_z_range": [null, null],
                             "healthy_angle_range": [null, null]})"));
}

}  // namespace
}  // namespace b4mrl
