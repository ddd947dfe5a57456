// Episode bounds, and the one rule by which a transition's next observation is chosen.
//
// kStored: every row, with the next observation that the file stores (the default).
// kD4rl: what d4rl.qlearning_dataset makes of a file: the next row's observation as next
// observation,
//   rows that end by time-out dropped, the last row never emitted. A terminal row stays; its next
//   observation is the next episode's first one, which bootstrapping never reads.
// Under kD4rl the timeouts column marks the last row of an episode that is left, so that episodes
// can still be told apart. Pure functions; any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "proto/base/status.h"

namespace b4mrl {

enum class TransitionRule { kStored, kD4rl };
std::string_view TransitionRuleName(TransitionRule rule);  // "stored", "d4rl"
// "" is the default.
Result<TransitionRule> ParseTransitionRule(std::string_view name);

// Rows [first, end) of one episode. `complete`: it ends with a terminal or a time-out, not with the
// data.
struct Episode {
  uint64_t first = 0;
  uint64_t end = 0;
  bool complete = false;
};
std::vector<Episode> FindEpisodes(std::span<const uint8_t> terminals,
                                  std::span<const uint8_t> timeouts);

// True when no row of this episode follows `row`: at terminals, time-outs and the end of the data.
inline bool EndsEpisode(std::span<const uint8_t> terminals, std::span<const uint8_t> timeouts,
                        uint64_t row) {
  return terminals[row] != 0 || timeouts[row] != 0 || row + 1 == terminals.size();
}

// kD4rl as a predicate: true when `row` is emitted, with observation row + 1 as its next
// observation.
inline bool D4rlKeeps(std::span<const uint8_t> timeouts, uint64_t row) {
  return row + 1 < timeouts.size() && timeouts[row] == 0;
}
// The timeouts mark of a kept row.
inline bool D4rlTimeout(std::span<const uint8_t> terminals, std::span<const uint8_t> timeouts,
                        uint64_t row) {
  return terminals[row] == 0 && timeouts[row + 1] != 0;
}

// For a file without time-outs: an episode ends when it has `limit` rows without a terminal.
std::vector<uint8_t> InferTimeouts(std::span<const uint8_t> terminals, uint64_t limit);
inline constexpr uint64_t kD4rlStepLimit = 1000;

}  // namespace b4mrl
