#include "benchmarks/evidence/growth.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "benchmarks/statistics/trend.h"

namespace b4mrl {
namespace {

constexpr size_t kFewestPoints = 5;
// So that a file with a million evaluations costs no more than one with a few hundred.
constexpr size_t kMostPoints = 256;

}  // namespace

std::optional<double> GainPerDoubling(const Curve& curve) {
  if (curve.empty()) return std::nullopt;
  const uint64_t half = curve.back().updates / 2;
  const auto first = std::ranges::upper_bound(curve, half, {}, &CurvePoint::updates);
  const auto count = static_cast<size_t>(curve.end() - first);
  if (count < kFewestPoints) return std::nullopt;
  const size_t stride = (count + kMostPoints - 1) / kMostPoints;
  std::vector<double> doublings, scores;
  for (size_t i = 0; i < count; i += stride) {
    const CurvePoint& point = first[static_cast<std::ptrdiff_t>(i)];
    doublings.push_back(std::log2(static_cast<double>(point.updates)));
    scores.push_back(point.score.value_or(point.mean_return));
  }
  return MedianSlope(doublings, scores);
}

}  // namespace b4mrl
