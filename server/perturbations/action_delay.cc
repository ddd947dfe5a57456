// action-delay=STEPS: each step executes the action of STEPS steps ago; the first STEPS steps of an
// episode execute zeros. The queue is lane state, oldest action first, so snapshots carry it. An
// action is executed in the number type of the step that executes it, which differs from its own
// only where a client changes its type within an episode.
#include <algorithm>

#include "server/perturbations/list.h"

namespace b4mrl {
namespace {

class ActionDelay final : public NumberPerturbation {
 public:
  using NumberPerturbation::NumberPerturbation;

  size_t state_size(const EnvironmentSpec& spec) const override {
    return static_cast<size_t>(fixed_number()) * spec.action.size();
  }

  void OnAction(const DrawContext& /*context*/, std::span<double> state,
                std::span<double> action) const override {
    if (state.empty()) return;
    std::ranges::swap_ranges(action, state.first(action.size()));
    std::ranges::rotate(state, state.begin() + static_cast<ptrdiff_t>(action.size()));
  }
};

// The paper gives no number of steps; 2 is ours.
constexpr Preset kPresets[] = {{"action-delay", "HalfCheetah", "action-delay", "2"},
                               {"action-delay", "Hopper", "action-delay", "2"},
                               {"action-delay", "Walker2d", "action-delay", "2"},
                               {"action-delay", "Humanoid", "action-delay", "2"},
                               {"action-delay", "Highway", "action-delay", "2"}};

}  // namespace

extern const PerturbationEntry kActionDelay;  // its line in list.cc
constinit const PerturbationEntry kActionDelay = {
    .name = "action-delay",
    .parameter = "steps",
    .type = "integer",
    .low = 0,
    .high = 100,
    .description = "executes each action a number of steps later; the first executed actions are 0",
    .presets = kPresets,
    .make = MakeNumberPerturbation<ActionDelay>};

}  // namespace b4mrl
