// The ego's observation, a table of the cars around it (highway-env's Kinematics), and the traffic
// that such a table describes.
#pragma once

#include <span>
#include <string_view>

#include "server/highway/settings.h"
#include "server/highway/traffic.h"

namespace b4mrl {

// highway-env's name of a feature: "presence", "x", ...
std::string_view FeatureName(HighwayFeature feature);
// A feature's unit: "m", "m/s", "rad" or "".
std::string_view FeatureUnit(HighwayFeature feature);

// Row 0 is the ego, absolute; the others are the cars nearest along the road within 200 m and,
// unless see_behind, no more than 10 m behind, with position and velocity relative to the ego
// unless absolute. Rows without a car are 0. Numbers are rounded to float32, highway-env's type.
// `observation` has settings.size() numbers, row by row.
void ObserveTraffic(const HighwayObservationSettings& settings, const Traffic& traffic,
                    std::span<double> observation);

// Whether an observation with these columns tells where the cars are and how they move: presence,
// unless its range shows it as the 0 of rows without a car, x, y, vx and vy.
bool DescribesTraffic(const HighwayObservationSettings& settings);

// Whether it also tells where they head: heading, or cos_h and sin_h.
bool DescribesHeadings(const HighwayObservationSettings& settings);

// Puts the ego and every car whose row says that it is present where the observation shows them;
// the settings describe traffic, and the capacity is at least settings.rows. What an observation
// does not tell is taken as for a car that has just been created there: it faces along the road, so
// that one which moves against it reverses, unless headings are described; it keeps its lane, its
// timer follows from its place, its commands are 0 and nothing has crashed; delta is the mean, 4,
// and the target speed is its own, brought into the range of new cars (21..24 m/s). Cars that are
// not shown do not exist. A value that was clipped stays at the clip's bound, so the ego is at most
// 200 m down the road. A number hidden as 0 is the middle of its range: a hidden ego speed means
// standing still, another car's the ego's speed; a hidden y of the ego means the leftmost lane,
// another car's the ego's y. Returns false, without any car, unless all numbers are finite.
bool TrafficFromObservation(const HighwayObservationSettings& settings, int lanes,
                            std::span<const double> observation, Traffic& traffic);

}  // namespace b4mrl
