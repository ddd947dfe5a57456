// Which random numbers the starts of a lane's episodes are made of. That they are highway-env's own
// is tested on recordings (simulation_test.cc).
#include "server/highway/creation.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <optional>
#include <set>
#include <vector>

namespace b4mrl {
namespace {

constexpr size_t kMost = 20;  // cars beside the ego

// The uniform numbers in [0, 1) that the other cars' speeds and deltas were made of, to 40 bits.
std::vector<int64_t> DrawsOf(const Traffic& traffic) {
  std::vector<int64_t> draws;
  for (int i = 1; i < traffic.count; ++i) {
    draws.push_back(std::llround((traffic.speed[i] - 21) / 3 * 0x1p40));
    draws.push_back(std::llround((traffic.delta[i] - 3.5) * 0x1p40));
  }
  return draws;
}

HighwaySettings WithCars(size_t count, std::optional<size_t> most) {
  HighwaySettings settings;
  settings.vehicles_count = count;
  settings.most_vehicles = most;
  return settings;
}

TEST_CASE("No two episodes of a lane share a random number, however many cars each of them has") {
  for (const int lanes : {1, 3}) {
    Traffic traffic(kMost + 1);
    std::set<int64_t> seen;
    for (uint64_t episode = 0; episode < 200; ++episode) {
      INFO(lanes << " lanes, episode " << episode);
      HighwaySettings settings = WithCars(1 + episode * 7 % kMost, kMost);
      settings.lanes_count = lanes;
      CreateTraffic(settings, /*seed=*/5, episode, traffic);
      for (const int64_t draw : DrawsOf(traffic)) REQUIRE(seen.insert(draw).second);
    }
  }
}

TEST_CASE("An episode with the most cars starts as where all episodes have that many") {
  Traffic fixed(kMost + 1), varied(kMost + 1), fewer(kMost + 1);
  for (const uint64_t episode : {0, 1, 2, 7, 1000}) {
    CreateTraffic(WithCars(kMost, {}), 5, episode, fixed);
    CreateTraffic(WithCars(kMost, kMost), 5, episode, varied);
    CHECK(varied.x == fixed.x);
    CHECK(varied.speed == fixed.speed);
    CreateTraffic(WithCars(4, kMost), 5, episode, fewer);
    CHECK(fewer.count == 5);
    CHECK(std::equal(fewer.x.begin(), fewer.x.begin() + 5, fixed.x.begin()));
  }
}

}  // namespace
}  // namespace b4mrl
