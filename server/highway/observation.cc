#include "server/highway/observation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "server/highway/creation.h"
#include "server/highway/road.h"

namespace b4mrl {
namespace {

constexpr double kSight = 5 * kMaxSpeed;             // m
constexpr double kSightBehind = 2 * kVehicleLength;  // m
constexpr double kMeanDelta = 4;

struct FeatureInfo {
  std::string_view name;
  std::string_view unit;
};
constexpr std::array<FeatureInfo, 13> kFeatures = {{{"presence", ""},
                                                    {"x", "m"},
                                                    {"y", "m"},
                                                    {"vx", "m/s"},
                                                    {"vy", "m/s"},
                                                    {"heading", "rad"},
                                                    {"cos_h", ""},
                                                    {"sin_h", ""},
                                                    {"cos_d", ""},
                                                    {"sin_d", ""},
                                                    {"long_off", "m"},
                                                    {"lat_off", "m"},
                                                    {"ang_off", "rad"}}};

double Feature(const Traffic& t, int i, HighwayFeature feature) {
  switch (feature) {
    case HighwayFeature::kPresence:
      return 1;
    case HighwayFeature::kX:
    case HighwayFeature::kLongitudinalOffset:
      return t.x[i];
    case HighwayFeature::kY:
      return t.y[i];
    case HighwayFeature::kVx:
      return t.speed[i] * t.cos_heading[i];
    case HighwayFeature::kVy:
      return t.speed[i] * t.sin_heading[i];
    case HighwayFeature::kHeading:
      return t.heading[i];
    case HighwayFeature::kCosHeading:
      return t.cos_heading[i];
    case HighwayFeature::kSinHeading:
      return t.sin_heading[i];
    case HighwayFeature::kCosDestination:
    case HighwayFeature::kSinDestination:
      return 0;
    case HighwayFeature::kLateralOffset:
      return t.y[i] - LaneCentre(t.lane[i]);
    case HighwayFeature::kAngularOffset:
      return WrapAngle(t.heading[i]);
  }
  return 0;
}

bool IsRelative(HighwayFeature feature) {
  return feature >= HighwayFeature::kX && feature <= HighwayFeature::kVy;
}

double Normalise(const NumberRange& range, bool clip, double value) {
  const double mapped = -1 + (value - range.low) * 2 / (range.high - range.low);
  return clip ? std::clamp(mapped, -1.0, 1.0) : mapped;
}

// Chooses the cars in sight, in the order of their rows; returns how many cars get a row.
size_t ChooseCars(const HighwayObservationSettings& settings, const Traffic& t,
                  std::array<int, kMaxVehicles>& chosen) {
  std::array<double, kMaxVehicles> distance;
  size_t count = 0;
  for (int i = kEgo + 1; i < t.count; ++i) {
    const double dx = t.x[i] - t.x[kEgo];
    const double dy = t.y[i] - t.y[kEgo];
    if (!(std::sqrt(dx * dx + dy * dy) < kSight)) continue;
    if (!settings.see_behind && !(-kSightBehind < dx)) continue;
    size_t place = count++;
    if (settings.sorted) {  // insertion keeps cars at equal distance in order
      for (; place > 0 && distance[place - 1] > std::abs(dx); --place) {
        distance[place] = distance[place - 1];
        chosen[place] = chosen[place - 1];
      }
    }
    distance[place] = std::abs(dx);
    chosen[place] = i;
  }
  return std::min(count, settings.rows - 1);
}

bool Has(const HighwayObservationSettings& settings, HighwayFeature feature) {
  return std::ranges::count(settings.columns, feature,
                            &HighwayObservationSettings::Column::feature) > 0;
}

// What the presence of a car is in an observation; rows without a car have 0.
double ShownPresence(const HighwayObservationSettings& settings) {
  const auto column = std::ranges::find(settings.columns, HighwayFeature::kPresence,
                                        &HighwayObservationSettings::Column::feature);
  if (column == settings.columns.end()) return 0;
  return column->range ? Normalise(*column->range, settings.clip, 1) : 1;
}

// A car's position (m) and velocity (m/s) as a row of an observation says them, and where it heads
// (rad) if the observation says so.
struct Sight {
  double shown_presence = 0;  // as the row has it
  double x = 0, y = 0, vx = 0, vy = 0;
  std::optional<double> heading, cos_heading, sin_heading;
};

Sight ReadRow(const HighwayObservationSettings& settings, std::span<const double> row) {
  Sight sight;
  for (size_t k = 0; k < row.size(); ++k) {
    const HighwayObservationSettings::Column& column = settings.columns[k];
    double value = row[k];
    if (column.range.has_value()) {
      const NumberRange& range = *column.range;
      value = range.low + (value + 1) * (range.high - range.low) / 2;
    }
    if (column.feature == HighwayFeature::kPresence) sight.shown_presence = row[k];
    if (column.feature == HighwayFeature::kX) sight.x = value;
    if (column.feature == HighwayFeature::kY) sight.y = value;
    if (column.feature == HighwayFeature::kVx) sight.vx = value;
    if (column.feature == HighwayFeature::kVy) sight.vy = value;
    if (column.feature == HighwayFeature::kHeading) sight.heading = value;
    if (column.feature == HighwayFeature::kCosHeading) sight.cos_heading = value;
    if (column.feature == HighwayFeature::kSinHeading) sight.sin_heading = value;
  }
  if (!sight.heading && sight.cos_heading && sight.sin_heading) {
    sight.heading = std::atan2(*sight.sin_heading, *sight.cos_heading);
  }
  return sight;
}

void Place(const Sight& sight, int lanes, Traffic& t) {
  const int i = t.count++;
  t.x[i] = sight.x;
  t.y[i] = sight.y;
  if (sight.heading) {
    t.heading[i] = *sight.heading;
    t.speed[i] = sight.vx * std::cos(*sight.heading) + sight.vy * std::sin(*sight.heading);
  } else {
    // Cars are taken to face along the road; one that moves against x is reversing. Adding 0 makes
    // 0 of -0, whose angle would be half a turn.
    const double direction = sight.vx < 0 ? -1 : 1;
    t.heading[i] = std::atan2(direction * sight.vy + 0.0, direction * sight.vx + 0.0);
    t.speed[i] = direction * std::sqrt(sight.vx * sight.vx + sight.vy * sight.vy);
  }
  t.Turn(i);
  t.lane[i] = ClosestLane(t.x[i], t.y[i], t.heading[i], lanes, 0);
  t.target_lane[i] = i == kEgo ? kNoLane : t.lane[i];
  if (i == kEgo) return;
  t.timer[i] = CreationTimer(t.x[i], t.y[i]);
  t.target_speed[i] = std::clamp(t.speed[i], kCreationSpeed.low, kCreationSpeed.high);
  t.delta[i] = kMeanDelta;
}

}  // namespace

std::string_view FeatureName(HighwayFeature feature) {
  return kFeatures[static_cast<size_t>(feature)].name;
}

std::string_view FeatureUnit(HighwayFeature feature) {
  return kFeatures[static_cast<size_t>(feature)].unit;
}

void ObserveTraffic(const HighwayObservationSettings& settings, const Traffic& t,
                    std::span<double> observation) {
  std::array<int, kMaxVehicles> chosen;
  const size_t cars = ChooseCars(settings, t, chosen);
  double* out = observation.data();
  for (size_t row = 0; row <= cars; ++row) {
    const int i = row == 0 ? kEgo : chosen[row - 1];
    for (const HighwayObservationSettings::Column& column : settings.columns) {
      double value = Feature(t, i, column.feature);
      if (row > 0 && !settings.absolute && IsRelative(column.feature)) {
        value -= Feature(t, kEgo, column.feature);
      }
      if (column.range.has_value()) value = Normalise(*column.range, settings.clip, value);
      *out++ = static_cast<float>(value);  // highway-env's type
    }
  }
  std::fill(out, observation.data() + observation.size(), 0);
}

bool DescribesTraffic(const HighwayObservationSettings& settings) {
  return ShownPresence(settings) != 0 && Has(settings, HighwayFeature::kX) &&
         Has(settings, HighwayFeature::kY) && Has(settings, HighwayFeature::kVx) &&
         Has(settings, HighwayFeature::kVy);
}

bool DescribesHeadings(const HighwayObservationSettings& settings) {
  return Has(settings, HighwayFeature::kHeading) ||
         (Has(settings, HighwayFeature::kCosHeading) && Has(settings, HighwayFeature::kSinHeading));
}

bool TrafficFromObservation(const HighwayObservationSettings& settings, int lanes,
                            std::span<const double> observation, Traffic& t) {
  t.Clear();
  for (const double value : observation) {
    if (!std::isfinite(value)) return false;
  }
  const size_t width = settings.columns.size();
  const Sight ego = ReadRow(settings, observation.first(width));
  Place(ego, lanes, t);
  const double presence = ShownPresence(settings);
  for (size_t row = 1; row < settings.rows; ++row) {
    Sight sight = ReadRow(settings, observation.subspan(row * width, width));
    if (!(sight.shown_presence / presence > 0.5)) continue;
    if (!settings.absolute) {
      sight.x += ego.x;
      sight.y += ego.y;
      sight.vx += ego.vx;
      sight.vy += ego.vy;
    }
    Place(sight, lanes, t);
  }
  return true;
}

}  // namespace b4mrl
