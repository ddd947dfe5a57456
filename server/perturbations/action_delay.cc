// action-delay=STEPS: each step executes the action of STEPS steps ago; the first STEPS steps of an
// episode execute zeros. The queue is lane state, oldest action first, so snapshots carry it.
#include <fmt/format.h>

#include <algorithm>

#include "server/perturbations/list.h"

namespace b4mrl {
namespace {

constexpr const char* kName = "action-delay";
constexpr uint64_t kHighSteps = 100;

class ActionDelay final : public Perturbation {
 public:
  explicit ActionDelay(uint64_t steps) : steps_(steps) {}

  NamedArgument ToNamedArgument() const override { return {kName, fmt::format("{}", steps_)}; }

  size_t state_size(const EnvironmentSpec& spec) const override {
    return steps_ * spec.action.size();
  }

  void OnAction(const DrawContext& /*context*/, std::span<double> state,
                std::span<double> action) const override {
    if (state.empty()) return;
    std::ranges::swap_ranges(action, state.first(action.size()));
    std::ranges::rotate(state, state.begin() + static_cast<ptrdiff_t>(action.size()));
  }

 private:
  uint64_t steps_;
};

Result<std::unique_ptr<Perturbation>> Make(const PerturbationInput& input) {
  B4MRL_ASSIGN_OR_RETURN(const uint64_t steps, ParseUnsigned(kName, input.argument, 0, kHighSteps));
  return std::unique_ptr<Perturbation>(std::make_unique<ActionDelay>(steps));
}

// The paper gives no number of steps; 2 is ours.
constexpr Preset kPresets[] = {{"action-delay", "HalfCheetah", "action-delay", "2"},
                               {"action-delay", "Hopper", "action-delay", "2"},
                               {"action-delay", "Walker2d", "action-delay", "2"},
                               {"action-delay", "Humanoid", "action-delay", "2"},
                               {"action-delay", "Highway", "action-delay", "2"}};

}  // namespace

extern const PerturbationEntry kActionDelay;  // its line in list.cc
constinit const PerturbationEntry kActionDelay = {
    .name = kName,
    .parameter = "steps",
    .type = "integer",
    .low = 0,
    .high = kHighSteps,
    .description = "executes each action a number of steps later; the first executed actions are 0",
    .corrupts_datasets = false,
    .presets = kPresets,
    .make = Make};

}  // namespace b4mrl
