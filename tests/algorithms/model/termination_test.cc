#include "algorithms/model/termination.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

namespace b4mrl {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
using Bounds = std::vector<DimensionBounds>;

EnvironmentSpec SpecOf(size_t observation_size, std::optional<Bounds> bounds) {
  EnvironmentSpec spec;
  spec.name = "Task";
  spec.observation.dimensions.resize(observation_size);
  spec.termination = std::move(bounds);
  return spec;
}

// As the catalogue has them (tests/server/environments/mujoco/termination_test.cc).
EnvironmentSpec Hopper() {
  Bounds bounds = {{0, 0.7, kInfinity}, {1, -0.2, 0.2}};
  for (uint32_t i = 2; i < 11; ++i) bounds.push_back({i, -kInfinity, 100});
  return SpecOf(11, bounds);
}
EnvironmentSpec Walker2d() { return SpecOf(17, Bounds{{0, 0.8, 2.0}, {1, -1, 1}}); }

// Whether a healthy observation that has `value` in `dimension` ends the episode.
bool EndsWith(const EnvironmentSpec& spec, size_t dimension, float value,
              std::span<const float> mask = {}) {
  const Result<Termination> termination = Termination::Of(spec, mask);
  REQUIRE(termination.ok());
  std::vector<float> observation(spec.observation.size(), 0.0f);
  observation[0] = 1.25f;  // a height that all of them have at the start
  REQUIRE_FALSE(termination->Ends(observation));
  observation[dimension] = value;
  return termination->Ends(observation);
}

}  // namespace

TEST_CASE("An environment without bounds never ends") {
  const EnvironmentSpec spec = SpecOf(17, Bounds{});
  for (const float value : {-1e30f, 0.0f, 1e30f}) CHECK_FALSE(EndsWith(spec, 0, value));
}

TEST_CASE("Hopper ends when it is low, leans, or is faster than its bound") {
  const EnvironmentSpec spec = Hopper();
  CHECK(EndsWith(spec, 0, 0.7f));  // the limits belong to the end
  CHECK_FALSE(EndsWith(spec, 0, std::nextafter(0.7f, 1.0f)));
  for (const float sign : {-1.0f, 1.0f}) {
    CHECK(EndsWith(spec, 1, sign * 0.2f));
    CHECK_FALSE(EndsWith(spec, 1, sign * std::nextafter(0.2f, 0.0f)));
  }
  for (const size_t dimension : {2u, 10u}) {
    CHECK(EndsWith(spec, dimension, 100.0f));
    CHECK_FALSE(EndsWith(spec, dimension, std::nextafter(100.0f, 0.0f)));
    // The source enforces no lower bound.
    CHECK_FALSE(EndsWith(spec, dimension, -1000.0f));
  }
}

TEST_CASE("Hopper ends when any number is not finite") {
  const EnvironmentSpec spec = Hopper();
  for (size_t dimension = 0; dimension < 11; ++dimension) {
    CHECK(EndsWith(spec, dimension, kInfinity));
    CHECK(EndsWith(spec, dimension, -kInfinity));
    CHECK(EndsWith(spec, dimension, kNan));
  }
}

TEST_CASE("Walker2d ends when it is low, high or leans") {
  const EnvironmentSpec spec = Walker2d();
  CHECK(EndsWith(spec, 0, 0.8f));
  CHECK_FALSE(EndsWith(spec, 0, std::nextafter(0.8f, 1.0f)));
  CHECK(EndsWith(spec, 0, 2.0f));
  CHECK_FALSE(EndsWith(spec, 0, std::nextafter(2.0f, 1.0f)));
  for (const float sign : {-1.0f, 1.0f}) {
    CHECK(EndsWith(spec, 1, sign * 1.0f));
    CHECK_FALSE(EndsWith(spec, 1, sign * std::nextafter(1.0f, 0.0f)));
  }
  CHECK_FALSE(EndsWith(spec, 2, 1e6f));
}

TEST_CASE("Humanoid ends beyond its heights, which are healthy themselves") {
  const EnvironmentSpec spec = SpecOf(376, Bounds{{0, 1.0, 2.0, /*inclusive=*/true}});
  CHECK_FALSE(EndsWith(spec, 0, 1.0f));
  CHECK(EndsWith(spec, 0, std::nextafter(1.0f, 0.0f)));
  CHECK_FALSE(EndsWith(spec, 0, 2.0f));
  CHECK(EndsWith(spec, 0, std::nextafter(2.0f, 3.0f)));
  CHECK_FALSE(EndsWith(spec, 1, -50.0f));
}

TEST_CASE("A hidden dimension, which is always zero, ends nothing") {
  const EnvironmentSpec spec = Walker2d();
  std::vector<float> mask(17, 1.0f);
  CHECK(EndsWith(spec, 0, 0.0f, mask));
  mask[0] = 0;
  CHECK_FALSE(EndsWith(spec, 0, 0.0f, mask));
  CHECK(EndsWith(spec, 1, 1.5f, mask));
}

TEST_CASE("An environment whose observations do not tell the end is refused by name") {
  const Status status = Termination::Of(SpecOf(25, std::nullopt)).status();
  CHECK(status.code() == StatusCode::kUnsupported);
  CHECK(status.message().find("Task") != std::string::npos);
}

TEST_CASE("Bounds on a dimension that is not there, from whatever server, are refused") {
  CHECK(Termination::Of(SpecOf(25, Bounds{{25, 0, 1}})).status().code() == StatusCode::kInternal);
  CHECK(Termination::Of(SpecOf(25, Bounds{{24, -1, 1}})).ok());
}

}  // namespace b4mrl
