// The learning curve of a run: its score after each evaluation, and whether it still moves. Value
// types; any thread.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

namespace b4mrl {

struct CurvePoint {
  uint64_t updates = 0;
  uint64_t steps = 0;
  double seconds = 0;  // of training until then; not in a result's curve
  double mean_return = 0;
  double std_return = 0;
  std::optional<double> score;
};
using Curve = std::vector<CurvePoint>;

// Means of the score, or of the return where there is no score, over the evaluations of a run's
// last fifth and of the fifth before.
struct Fifths {
  std::optional<double> last, before;
  // By how much the two may differ in a curve that has settled: kSettledPoints or, of returns,
  // which have no scale, kSettledShare of the span between its lowest and highest evaluation.
  double tolerance = 0;
  // The standard error of the movement, by how much the evaluations within each fifth vary, as if
  // each were a draw of its own; nothing if a fifth has fewer than two.
  std::optional<double> movement_error;
  // The last less the one before; nothing if one is missing.
  std::optional<double> Movement() const;
  // Whether they differ by at most the tolerance; nothing if one is missing.
  std::optional<bool> IsSettled() const;
};
inline constexpr double kSettledPoints = 1.5;
// As much as those points are of a run that learns fifty.
inline constexpr double kSettledShare = 0.03;
// Of a curve with a point or more.
Fifths FifthsOf(const Curve& curve);

// A result's entry "curve": [[updates, steps, return, std, score], ...].
nlohmann::ordered_json JsonOf(const Curve& curve);
// Nothing if `json` is no such list, or its updates do not ascend.
std::optional<Curve> ReadCurve(const nlohmann::ordered_json& json);

}  // namespace b4mrl
