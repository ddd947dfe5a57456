#include "server/highway/creation.h"

#include <algorithm>
#include <cmath>

#include "server/highway/numpy_random.h"
#include "server/highway/road.h"

namespace b4mrl {
namespace {

constexpr double kEgoSpeed = 25;  // m/s
constexpr NumberRange kSpacingFactor = {0.9, 1.1};
constexpr NumberRange kDelta = {3.5, 4.5};

// Random draws for each car but the ego: its lane, and three doubles.
constexpr uint64_t kDoublesPerOther = 3;  // speed, spacing, delta
constexpr uint64_t kDoublesOfEgo = 1;     // spacing

// Each episode before this one counts as one with the most vehicles, whatever it had: no two
// episodes of a lane then share random numbers, and the place is a function of the arguments alone.
NumpyRandom AtEpisode(const HighwaySettings& settings, uint64_t seed, uint64_t episode) {
  NumpyRandom random(seed);
  const uint64_t others = settings.most_vehicles.value_or(settings.vehicles_count);
  const uint64_t lane_draws = settings.lanes_count == 1              ? 0
                              : settings.initial_lane_id.has_value() ? others
                                                                     : others + 1;
  random.Skip(episode * (kDoublesOfEgo + kDoublesPerOther * others), episode * lane_draws,
              others > 0 ? kDoublesPerOther : kDoublesOfEgo);
  return random;
}

double Draw(NumpyRandom& random, const NumberRange& interval) {
  return random.Uniform(interval.low, interval.high);
}

}  // namespace

double CreationTimer(double x, double y) {
  const double timer = std::fmod((x + y) * kPi, 1.0);
  return timer < 0 ? timer + 1.0 : timer;
}

void CreateTraffic(const HighwaySettings& settings, uint64_t seed, uint64_t episode, Traffic& t) {
  NumpyRandom random = AtEpisode(settings, seed, episode);
  t.Clear();
  const double crowding = std::exp(-5.0 / 40 * settings.lanes_count);
  double furthest = 0;
  for (int i = 0; i <= static_cast<int>(settings.vehicles_count); ++i) {
    const bool ego = i == kEgo;
    const int lane = ego && settings.initial_lane_id.has_value()
                         ? *settings.initial_lane_id
                         : static_cast<int>(random.Below(settings.lanes_count));
    const double speed = ego ? kEgoSpeed : Draw(random, kCreationSpeed);
    const double spacing = ego ? settings.ego_spacing : 1 / settings.vehicles_density;
    const double offset = spacing * (12 + 1.0 * speed) * crowding;
    const double base = ego ? 3 * offset : furthest;
    t.count = i + 1;
    t.x[i] = base + offset * Draw(random, kSpacingFactor);
    t.y[i] = LaneCentre(lane);
    t.speed[i] = speed;
    t.lane[i] = ClosestLane(t.x[i], t.y[i], 0, settings.lanes_count, lane);
    t.target_lane[i] = ego ? kNoLane : t.lane[i];
    furthest = ego ? t.x[i] : std::max(furthest, t.x[i]);
    if (ego) continue;
    t.timer[i] = CreationTimer(t.x[i], t.y[i]);
    t.target_speed[i] = speed;
    t.delta[i] = Draw(random, kDelta);
  }
}

}  // namespace b4mrl
