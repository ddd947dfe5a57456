// What both sides must agree on about an environment: its spaces, its limits, and how perturbations
// and corruptions are written. Value types; no thread rule.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "proto/base/status.h"

namespace b4mrl {

// One coordinate of an observation or action.
struct DimensionSpec {
  std::string name;  // "v-root-z"; usable wherever a 0-based index is
  std::string unit;  // "m/s", "rad"; "" for none
  double low = 0;
  double high = 0;
  // Where an observation has rows (Highway's vehicles): what this column holds in each of them,
  // "vx" of "vehicle2-vx". "" elsewhere.
  std::string feature = "";
  // 0 or 1 and no measurement (Highway's presence): noise leaves it alone.
  bool flag = false;
};

// A box: dimensions in order, possibly reshaped (Highway's rows); the product of `shape` is their
// count.
struct SpaceSpec {
  std::vector<DimensionSpec> dimensions;
  std::vector<uint64_t> shape;

  size_t size() const { return dimensions.size(); }
  // Accepts a 0-based index ("9") or a name ("v-root-z").
  Result<uint32_t> FindDimension(std::string_view index_or_name) const;
  // The same, or a feature ("vx"), which names its column of every row. In ascending order.
  Result<std::vector<uint32_t>> FindDimensions(std::string_view index_name_or_feature) const;
};

// What a number of an observation lies in while the episode goes on. Numbers that are not finite
// are outside, even of a bound that is infinite.
struct DimensionBounds {
  uint32_t dimension = 0;
  double low = 0;
  double high = 0;
  bool inclusive = false;  // low and high themselves are inside
};

struct EnvironmentSpec {
  std::string name;  // "HalfCheetah"
  SpaceSpec observation;
  SpaceSpec action;
  std::string reward;  // the formula, in words
  uint32_t max_episode_steps = 0;
  double step_seconds = 0;  // simulated time of one step
  // What perturbations may need of an environment: "a MuJoCo model", "lower legs", "other cars".
  std::vector<std::string> features;
  // Returns that D4RL's normalised score maps to 0 and 100; none for environments D4RL lacks.
  std::optional<double> reference_min;
  std::optional<double> reference_max;
  // Gymnasium's info dictionary as columns of numbers: "x_position"; "tendon_length[1]" for the
  // second entry of an array; "rewards.collision_reward" for a dictionary within the dictionary.
  std::vector<std::string> info_names;
  std::vector<std::string> reset_info_names;  // those of them that a reset reports too
  // How a predicted observation tells that its episode ends: it is outside some bounds. Empty: the
  // episode never ends before its time. None: an observation does not tell.
  std::optional<std::vector<DimensionBounds>> termination;
  // Pixels of a picture when none are asked for.
  uint32_t picture_width = 480;
  uint32_t picture_height = 480;

  // 100 (return - min) / (max - min).
  std::optional<double> NormalisedScore(double episode_return) const;
};

// Why a step ended its episode. The numbers are those of the wire (proto/b4mrl.proto).
enum class Cause : uint8_t {
  kNone = 0,
  kUnhealthy = 1,       // terminated by the task's rule
  kLimit = 2,           // truncated by the step limit
  kCrash = 3,           // truncated: the step ended its process, or the engine gave it up
  kNumericalError = 4,  // truncated: the engine warned, or a number was not finite
};

// The numbers are those of the wire (proto/b4mrl.proto).
enum class AutoresetMode : uint8_t { kNextStep = 0, kSameStep = 1, kDisabled = 2 };

// One item of "gravity=1.5,obs-noise-low": a name and, after '=', its argument as written.
struct NamedArgument {
  std::string name;
  std::string argument;  // "" when there was none

  std::string ToString() const { return argument.empty() ? name : name + "=" + argument; }
  bool operator==(const NamedArgument&) const = default;
};

// Splits a comma-separated list; "" is the empty list. Spaces around names and arguments do not
// count. Refuses empty items and names with characters outside [a-z0-9-].
Result<std::vector<NamedArgument>> ParseNamedArguments(std::string_view text);
std::string FormatNamedArguments(const std::vector<NamedArgument>& items);

// A decimal number that uses the whole text and is finite; `name` is for the message.
Result<double> ParseFinite(std::string_view name, std::string_view text, double low, double high);
Result<uint64_t> ParseUnsigned(std::string_view name, std::string_view text, uint64_t low,
                               uint64_t high);

}  // namespace b4mrl
