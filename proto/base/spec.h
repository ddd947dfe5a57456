// What client and server must agree on about an environment: its spaces, its limits, and the syntax
// of perturbations and corruptions. Value types; no thread rule.
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
  std::string name;  // "v-root-z"; users may give it instead of the dimension's 0-based index
  std::string unit;  // "m/s", "rad"; "" for none
  double low = 0;
  double high = 0;
  // The quantity in this column, "vx" for "vehicle2-vx", if an observation has rows (Highway's
  // vehicles); "" in other environments.
  std::string feature = "";
  // Whether the coordinate is 0 or 1 and no measurement (Highway's presence); it gets no noise.
  // Known to the server alone: the protocol does not carry it.
  bool flag = false;
};

// A box: dimensions in order, possibly reshaped (Highway's rows); the product of `shape` is their
// count.
struct SpaceSpec {
  std::vector<DimensionSpec> dimensions;
  std::vector<uint64_t> shape;

  size_t size() const { return dimensions.size(); }
  // The dimension with a 0-based index ("9") or a name ("v-root-z").
  Result<uint32_t> FindDimension(std::string_view index_or_name) const;
  // The dimension with an index or name, or all dimensions with a feature ("vx"), ascending.
  Result<std::vector<uint32_t>> FindDimensions(std::string_view index_name_or_feature) const;
  // The dimensions in a list of indices, names and features joined by '+' ("9+v-root-x",
  // "y+vx+vy"), ascending and each once. The argument of the perturbation "hidden" is such a list.
  Result<std::vector<uint32_t>> ParseDimensions(std::string_view list) const;
};

// Bounds of one observation dimension: the episode ends when its value leaves them. Values that are
// not finite are outside, even if a bound is infinite.
struct DimensionBounds {
  uint32_t dimension = 0;
  double low = 0;
  double high = 0;
  bool inclusive = false;  // whether the values low and high are inside
};

struct EnvironmentSpec {
  std::string name;  // "HalfCheetah"
  SpaceSpec observation;
  SpaceSpec action;
  std::string reward;  // formula of the reward, in words
  uint32_t max_episode_steps = 0;
  double step_seconds = 0;  // simulated time of one step
  // Features that perturbations may require: "a MuJoCo model", "lower legs", "other cars". Known to
  // the server alone: a client finds in the catalogue to which environments a perturbation applies.
  std::vector<std::string> features;
  // Returns that D4RL's normalised score maps to 0 and 100; no values if D4RL lacks the
  // environment.
  std::optional<double> reference_min;
  std::optional<double> reference_max;
  // Gymnasium's info dictionary as columns of numbers: "x_position"; "tendon_length[1]" for the
  // second entry of an array; "rewards.collision_reward" for a dictionary within the dictionary.
  std::vector<std::string> info_names;
  std::vector<std::string> reset_info_names;  // the info_names that a reset reports, too
  // A predicted observation ends its episode if it is outside these bounds. Empty: episodes only
  // end at the step limit. No value: observations do not tell whether the episode ends.
  std::optional<std::vector<DimensionBounds>> termination;
  // Default size of a picture, in pixels.
  uint32_t picture_width = 480;
  uint32_t picture_height = 480;

  // The largest action in each dimension. Learners and agents act by it times a number in -1..1.
  std::vector<float> ActionScale() const;
  // kUnsupported unless every dimension's smallest action is its largest with the other sign.
  Status CheckActionScale() const;
  // kInvalidArgument unless what `owner` names ("the agent") has the environment's sizes.
  Status CheckSizes(std::string_view owner, uint64_t observation_size, uint64_t action_size) const;

  // D4RL's normalised score: 100 (return - reference_min) / (reference_max - reference_min).
  std::optional<double> NormalisedScore(double episode_return) const;
};

// Why a step ended its episode. The numbers are those of the protocol (proto/b4mrl.proto).
enum class Cause : uint8_t {
  kNone = 0,
  kUnhealthy = 1,       // terminated by the task's rule
  kLimit = 2,           // truncated by the step limit
  kCrash = 3,           // truncated: two crashes or eight kills ended the process at this step
  kNumericalError = 4,  // truncated: the engine warned or failed, or a number was not finite
};

// Gymnasium's autoreset modes. The numbers are those of the protocol (proto/b4mrl.proto).
enum class AutoresetMode : uint8_t { kNextStep = 0, kSameStep = 1, kDisabled = 2 };

// One item of "gravity=1.5,obs-noise-low": a name and, after '=', its argument as written.
struct NamedArgument {
  std::string name;
  std::string argument;  // "" if the item has no argument

  std::string ToString() const { return argument.empty() ? name : name + "=" + argument; }
  bool operator==(const NamedArgument&) const = default;
};

// Splits a comma-separated list; "" is the empty list. Spaces around names and arguments are
// dropped. Refuses empty items and names with characters outside [a-z0-9-].
Result<std::vector<NamedArgument>> ParseNamedArguments(std::string_view text);
std::string FormatNamedArguments(const std::vector<NamedArgument>& items);

// Parse a finite or an unsigned whole number in [low, high] that takes up the whole text; `name` is
// for the message.
Result<double> ParseFinite(std::string_view name, std::string_view text, double low, double high);
Result<uint64_t> ParseUnsigned(std::string_view name, std::string_view text, uint64_t low,
                               uint64_t high);

}  // namespace b4mrl
