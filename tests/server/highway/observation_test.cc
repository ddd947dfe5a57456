// The table that the ego sees, and the cars that a table describes.
#include "server/highway/observation.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <limits>

#include "server/highway/creation.h"
#include "server/highway/simulation.h"

namespace b4mrl {
namespace {

constexpr int kLanes = 3;

// Cars at (x, y) with a speed, all straight.
Traffic MakeTraffic(const std::vector<std::array<double, 3>>& cars) {
  Traffic traffic(8);
  for (const auto& [x, y, speed] : cars) {
    const int i = traffic.count++;
    traffic.x[i] = x;
    traffic.y[i] = y;
    traffic.speed[i] = speed;
  }
  return traffic;
}

std::vector<double> Observe(const HighwayObservationSettings& settings, const Traffic& traffic) {
  std::vector<double> observation(settings.size(), 99);
  ObserveTraffic(settings, traffic, observation);
  return observation;
}

HighwayObservationSettings Plain(size_t rows) {
  HighwayObservationSettings settings;
  for (auto& column : settings.columns) column.range.reset();
  settings.rows = rows;
  return settings;
}

TEST_CASE("Rows are the ego and the nearest cars ahead or just behind, nearest first") {
  const Traffic traffic = MakeTraffic(
      {{100, 4, 25}, {150, 0, 20}, {95, 8, 30}, {89, 4, 30}, {299.9, 4, 22}, {300.1, 4, 22}});
  CHECK(Observe(Plain(5), traffic) == std::vector<double>{1,  100,
                                                          4,  25,
                                                          0,  //
                                                          1,  -5,
                                                          4,  5,
                                                          0,  // 5 m behind
                                                          1,  50,
                                                          -4, -5,
                                                          0,  //
                                                          1,  static_cast<float>(199.9),
                                                          0,  -3,
                                                          0,  // the one 200.1 m away is unseen
                                                          0,  0,
                                                          0,  0,
                                                          0});
  HighwayObservationSettings behind = Plain(3);
  behind.see_behind = true;
  CHECK(Observe(behind, traffic)[11] == -11);  // 11 m behind comes before 50 m ahead
  behind.sorted = false;
  CHECK(Observe(behind, traffic)[6] == 50);  // in the list's order
  HighwayObservationSettings absolute = Plain(2);
  absolute.absolute = true;
  CHECK(Observe(absolute, traffic)[6] == 95);
}

TEST_CASE("Cars at equal distances keep the order of their numbers") {
  const Traffic traffic = MakeTraffic({{100, 4, 25}, {150, 8, 20}, {150, 0, 21}, {150, 4, 22}});
  const std::vector<double> seen = Observe(Plain(4), traffic);
  CHECK(seen[5 + 2] == 4);  // the other lanes, relative to the ego's
  CHECK(seen[10 + 2] == -4);
  CHECK(seen[15 + 2] == 0);
}

TEST_CASE("Ranges are mapped to [-1, 1], clipped unless told otherwise") {
  const Traffic traffic = MakeTraffic({{500, 4, 20}, {540, 8, 20}});
  HighwayObservationSettings settings;
  settings.rows = 2;
  const std::vector<double> clipped = Observe(settings, traffic);
  CHECK(clipped[1] == 1);
  CHECK(clipped[6] == Approx(0.2).epsilon(1e-7));  // float32
  settings.clip = false;
  CHECK(Observe(settings, traffic)[1] == 2.5);
}

TEST_CASE("An observation describes cars that it shows again") {
  Traffic traffic = MakeTraffic({{100, 4, 25}, {150, 1, 20}, {120, 8, 30}, {180, 4, 22}});
  traffic.heading[1] = 0.1;
  traffic.Turn(1);
  const HighwayObservationSettings settings;
  const std::vector<double> seen = Observe(settings, traffic);
  Traffic set(5);
  REQUIRE(TrafficFromObservation(settings, kLanes, seen, set));
  REQUIRE(set.count == 4);
  const std::vector<double> again = Observe(settings, set);
  // Two roundings to float32 of numbers up to 1.
  for (size_t i = 0; i < seen.size(); ++i) CHECK(again[i] == Approx(seen[i]).margin(3e-7));
  CHECK(set.heading[2] == Approx(0.1).margin(1e-5));  // 2 m/s across, to float32 of 80 m/s
  CHECK(set.speed[2] == Approx(20).margin(1e-4));
  CHECK(set.lane[2] == 0);
  CHECK(set.target_lane[2] == 0);
  CHECK(set.target_lane[kEgo] == kNoLane);
  CHECK(set.target_speed[2] == 21);  // of new cars: 21 to 24
  CHECK(set.target_speed[1] == 24);
  CHECK(set.timer[3] == CreationTimer(set.x[3], set.y[3]));
  CHECK(set.delta[3] == 4);
}

TEST_CASE("Hidden columns are zeros, and a zero is the middle of its range") {
  const Traffic traffic = MakeTraffic({{100, 4, 25}, {150, 0, 20}});
  const HighwayObservationSettings settings;
  std::vector<double> seen = Observe(settings, traffic);
  for (size_t row = 0; row < settings.rows; ++row) {
    for (size_t column = 2; column < 5; ++column) seen[row * 5 + column] = 0;  // y, vx, vy
  }
  Traffic set(5);
  REQUIRE(TrafficFromObservation(settings, kLanes, seen, set));
  REQUIRE(set.count == 2);
  for (int i = 0; i < 2; ++i) {
    CHECK(set.y[i] == 0);
    CHECK(set.speed[i] == 0);
    CHECK(set.heading[i] == 0);
  }
  CHECK(set.x[1] - set.x[0] == Approx(50).margin(1e-4));  // float32 of 200 m
}

TEST_CASE("A car that moves against the road is taken to reverse") {
  const Traffic traffic = MakeTraffic({{100, 4, -3}});
  const HighwayObservationSettings settings = Plain(1);
  Traffic set(1);
  REQUIRE(TrafficFromObservation(settings, kLanes, Observe(settings, traffic), set));
  CHECK(set.speed[0] == -3);
  CHECK(set.heading[0] == 0);
}

TEST_CASE("A car that has turned round drives on, where headings are told") {
  Traffic traffic = MakeTraffic({{100, 4, 10}, {150, 4, 0}, {130, 8, -3}});
  const double headings[] = {2.8, -2, 0.1};
  for (int i = 0; i < 3; ++i) {
    traffic.heading[i] = headings[i];
    traffic.Turn(i);
  }
  using Features = std::vector<HighwayFeature>;
  for (const Features& told :
       {Features{HighwayFeature::kHeading},
        Features{HighwayFeature::kCosHeading, HighwayFeature::kSinHeading}}) {
    HighwayObservationSettings settings = Plain(3);
    CHECK_FALSE(DescribesHeadings(settings));
    for (const HighwayFeature feature : told) settings.columns.push_back({feature, {}});
    REQUIRE(DescribesHeadings(settings));
    settings.sorted = false;
    Traffic set(3);
    REQUIRE(TrafficFromObservation(settings, kLanes, Observe(settings, traffic), set));
    REQUIRE(set.count == 3);
    for (int i = 0; i < 3; ++i) {
      // Of numbers to float32: angles up to 3, speeds up to 10 less the ego's.
      CHECK(set.heading[i] == Approx(headings[i]).margin(1e-6));
      CHECK(set.speed[i] == Approx(traffic.speed[i]).margin(1e-5));
    }
  }
}

TEST_CASE("A velocity of negative zeros faces along the road") {
  std::vector<double> seen = {1, 100, 4, -0.0, -0.0};
  Traffic set(1);
  REQUIRE(TrafficFromObservation(Plain(1), kLanes, seen, set));
  CHECK(set.heading[0] == 0);
  CHECK_FALSE(std::signbit(set.speed[0]));
}

TEST_CASE("A presence that is mapped tells which rows have a car, unless it is shown as 0") {
  const Traffic traffic = MakeTraffic({{100, 4, 25}, {150, 4, 20}, {160, 4, 20}});
  for (const bool clip : {true, false}) {
    for (const NumberRange range : {NumberRange{0, 0.5}, NumberRange{0, 3}, NumberRange{-9, 2}}) {
      HighwayObservationSettings settings = Plain(5);
      settings.clip = clip;
      settings.columns.front().range = range;
      REQUIRE(DescribesTraffic(settings));
      Traffic set(5);
      REQUIRE(TrafficFromObservation(settings, kLanes, Observe(settings, traffic), set));
      CHECK(set.count == 3);
    }
  }
  HighwayObservationSettings settings = Plain(5);
  settings.columns.front().range = NumberRange{0, 2};
  CHECK_FALSE(DescribesTraffic(settings));
}

TEST_CASE("What is not finite describes nothing") {
  const HighwayObservationSettings settings;
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    std::vector<double> observation(settings.size(), 0.1);
    observation[7] = bad;
    Traffic set(5);
    CHECK_FALSE(TrafficFromObservation(settings, kLanes, observation, set));
    CHECK(set.count == 0);
  }
}

TEST_CASE("Columns that leave position or velocity open do not describe traffic") {
  HighwayObservationSettings settings;
  CHECK(DescribesTraffic(settings));
  settings.columns.pop_back();
  CHECK_FALSE(DescribesTraffic(settings));
}

TEST_CASE("Numbers of any size in a saved state stay within the simulator's arrays") {
  HighwaySettings settings;
  settings.vehicles_count = 4;
  HighwaySimulation simulation(settings, 5);
  for (const double bad : {1e300, -1e300, 0.5, -7.0}) {
    std::vector<double> state(Traffic::StateSize(5), bad);
    simulation.traffic.Load(state, settings.lanes_count);
    CHECK(simulation.traffic.count >= 1);
    CHECK(simulation.traffic.count <= 5);
    for (int step = 0; step < 3; ++step) simulation.Step({1, 0.1});
    CHECK(simulation.traffic.lane[0] >= 0);
    CHECK(simulation.traffic.lane[0] < settings.lanes_count);
  }
}

}  // namespace
}  // namespace b4mrl
