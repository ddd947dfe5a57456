// action-noise=STD: adds STD times an independent standard normal to every component of the action
// that is executed, and clips the sum to the action space. The caller still records the action that
// it chose; reward and control cost are those of the executed action. Another STD scales the same
// normals.
#include <algorithm>

#include "server/perturbations/list.h"

namespace b4mrl {
namespace {

class ActionNoise final : public NumberPerturbation {
 public:
  ActionNoise(const PerturbationInput& input, const NumberArgument& std)
      : NumberPerturbation(input, std) {
    for (const DimensionSpec& dimension : input.spec->action.dimensions) {
      bounds_.push_back({dimension.low, dimension.high});
    }
  }

  void OnAction(const DrawContext& context, std::span<double> /*state*/,
                std::span<double> action) const override {
    Rng rng = RowRng(context, action.size());
    for (size_t i = 0; i < action.size(); ++i) {
      const double noisy = action[i] + fixed_number() * rng.Normal();
      action[i] = std::clamp(noisy, bounds_[i].low, bounds_[i].high);
    }
  }
  bool keeps_float32() const override { return false; }

 private:
  struct Bounds {
    double low;
    double high;
  };
  std::vector<Bounds> bounds_;
};

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
    .name = "action-noise",
    .parameter = "std",
    .type = "number",
    .low = 0,
    .high = 1e6,
    .description = "adds independent normal noise to the executed action, clipped to its bounds",
    .presets = kPresets,
    .make = MakeNumberPerturbation<ActionNoise>};

}  // namespace b4mrl
