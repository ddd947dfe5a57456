// The slope of a noisy curve. Pure functions; any thread.
#pragma once

#include <optional>
#include <span>

namespace b4mrl {

// The median of the slopes between all pairs of points (Theil and Sen; scipy.stats.theilslopes),
// which a few outliers hardly move. x[i] and y[i] belong together; pairs with equal x have no
// slope. Nothing without a pair that has one. Its time and memory are quadratic in the number of
// points.
std::optional<double> MedianSlope(std::span<const double> x, std::span<const double> y);

}  // namespace b4mrl
