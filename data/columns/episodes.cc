#include "data/columns/episodes.h"

#include <array>

namespace b4mrl {

std::string_view TransitionRuleName(TransitionRule rule) {
  return rule == TransitionRule::kStored ? "stored" : "d4rl";
}

Result<TransitionRule> ParseTransitionRule(std::string_view name) {
  if (name.empty() || name == "stored") return TransitionRule::kStored;
  if (name == "d4rl") return TransitionRule::kD4rl;
  return UnknownName("transition rule", name, std::array<std::string_view, 2>{"stored", "d4rl"});
}

std::vector<uint8_t> InferTimeouts(std::span<const uint8_t> terminals, uint64_t limit) {
  std::vector<uint8_t> timeouts(terminals.size(), 0);
  uint64_t steps = 0;
  for (size_t row = 0; row < terminals.size(); ++row) {
    ++steps;
    if (terminals[row] != 0) {
      steps = 0;
    } else if (steps == limit) {
      timeouts[row] = 1;
      steps = 0;
    }
  }
  return timeouts;
}

}  // namespace b4mrl
