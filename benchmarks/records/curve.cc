#include "benchmarks/records/curve.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "proto/base/mean_and_std.h"

namespace b4mrl {
namespace {

using Json = nlohmann::ordered_json;

constexpr size_t kColumns = 5;

// Those of the evaluations in (from, to] of the run.
std::vector<double> ScoresBetween(const Curve& curve, double from, double to) {
  std::vector<double> scores;
  const auto last = static_cast<double>(curve.back().updates);
  for (const CurvePoint& each : curve) {
    const auto updates = static_cast<double>(each.updates);
    if (updates <= from * last || updates > to * last) continue;
    scores.push_back(each.score.value_or(each.mean_return));
  }
  return scores;
}

std::optional<double> MeanOf(const std::vector<double>& scores) {
  if (scores.empty()) return std::nullopt;
  return MeanAndStdOf(scores).mean;
}

// The square of their mean's standard error; they are two or more.
double SquaredErrorOf(const std::vector<double>& scores) {
  const double std = MeanAndStdOf(scores).std;
  return std * std / static_cast<double>(scores.size() - 1);
}

}  // namespace

std::optional<double> Fifths::Movement() const {
  if (!last || !before) return std::nullopt;
  return *last - *before;
}

std::optional<bool> Fifths::IsSettled() const {
  const std::optional<double> movement = Movement();
  if (!movement) return std::nullopt;
  return std::abs(*movement) <= tolerance;
}

Fifths FifthsOf(const Curve& curve) {
  const auto last = ScoresBetween(curve, 0.8, 1), before = ScoresBetween(curve, 0.6, 0.8);
  Fifths fifths = {MeanOf(last), MeanOf(before), kSettledPoints};
  if (last.size() > 1 && before.size() > 1) {
    fifths.movement_error = std::sqrt(SquaredErrorOf(last) + SquaredErrorOf(before));
  }
  if (!curve.back().score) {
    const auto [low, high] = std::ranges::minmax(curve, {}, &CurvePoint::mean_return);
    fifths.tolerance = kSettledShare * (high.mean_return - low.mean_return);
  }
  return fifths;
}

Json JsonOf(const Curve& curve) {
  Json json = Json::array();
  for (const CurvePoint& each : curve) {
    json.push_back({each.updates, each.steps, each.mean_return, each.std_return,
                    each.score ? Json(*each.score) : Json()});
  }
  return json;
}

std::optional<Curve> ReadCurve(const Json& json) {
  if (!json.is_array()) return std::nullopt;
  Curve curve;
  for (const Json& row : json) {
    if (!row.is_array() || row.size() != kColumns || !row[0].is_number_unsigned() ||
        !row[1].is_number_unsigned() || !row[2].is_number() || !row[3].is_number() ||
        !(row[4].is_number() || row[4].is_null())) {
      return std::nullopt;
    }
    CurvePoint point;
    point.updates = row[0].get<uint64_t>();
    point.steps = row[1].get<uint64_t>();
    point.mean_return = row[2].get<double>();
    point.std_return = row[3].get<double>();
    if (row[4].is_number()) point.score = row[4].get<double>();
    if (!curve.empty() && curve.back().updates >= point.updates) return std::nullopt;
    curve.push_back(point);
  }
  return curve;
}

}  // namespace b4mrl
