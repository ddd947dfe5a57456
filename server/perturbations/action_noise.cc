// action-noise=STD: adds STD times an independent standard normal to every component of the action
// that is executed, and clips the sum to the action space. The caller still records the action that
// it chose; reward and control cost are those of the executed action. Another STD scales the same
// normals.
#include <fmt/format.h>

#include <algorithm>

#include "server/perturbations/list.h"

namespace b4mrl {
namespace {

constexpr const char* kName = "action-noise";
constexpr double kLow = 0;
constexpr double kHigh = 1e6;

class ActionNoise final : public Perturbation {
 public:
  ActionNoise(double std, uint64_t occurrence, const SpaceSpec& space)
      : std_(std), occurrence_(occurrence) {
    for (const DimensionSpec& dimension : space.dimensions) {
      bounds_.push_back({dimension.low, dimension.high});
    }
  }

  NamedArgument ToNamedArgument() const override { return {kName, fmt::format("{}", std_)}; }

  void OnAction(const DrawContext& context, std::span<double> /*state*/,
                std::span<double> action) const override {
    Rng rng = RowRng(context, kName, occurrence_, action.size());
    for (size_t i = 0; i < action.size(); ++i) {
      action[i] = std::clamp(action[i] + std_ * rng.Normal(), bounds_[i].low, bounds_[i].high);
    }
  }

 private:
  struct Bounds {
    double low;
    double high;
  };
  double std_;
  uint64_t occurrence_;
  std::vector<Bounds> bounds_;
};

Result<std::unique_ptr<Perturbation>> Make(const PerturbationInput& input) {
  B4MRL_ASSIGN_OR_RETURN(const double std, ParseFinite(kName, input.argument, kLow, kHigh));
  return std::unique_ptr<Perturbation>(
      std::make_unique<ActionNoise>(std, input.occurrence, input.spec->action));
}

constexpr Preset kPresets[] = {{"action-noise-low", "HalfCheetah", "action-noise", "0.2"},
                               {"action-noise-low", "Hopper", "action-noise", "0.5"},
                               {"action-noise-low", "Walker2d", "action-noise", "0.2"},
                               {"action-noise-low", "Highway", "action-noise", "0.5"},
                               {"action-noise-high", "HalfCheetah", "action-noise", "0.5"},
                               {"action-noise-high", "Hopper", "action-noise", "1"},
                               {"action-noise-high", "Walker2d", "action-noise", "0.5"},
                               {"action-noise-high", "Highway", "action-noise", "1"}};

}  // namespace

extern const PerturbationEntry kActionNoise;  // its line in list.cc
constinit const PerturbationEntry kActionNoise = {
    .name = kName,
    .parameter = "std",
    .type = "number",
    .low = kLow,
    .high = kHigh,
    .description = "adds independent normal noise to the executed action, clipped to its bounds",
    .corrupts_datasets = false,
    .presets = kPresets,
    .make = Make};

}  // namespace b4mrl
