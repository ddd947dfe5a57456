// Episode bounds, and the one rule by which a transition's next observation is chosen.
//
// kStored (the default): every row, with the next observation that the file stores.
// kD4rl: the rows that d4rl.qlearning_dataset returns, if the file has timeouts. (Without them,
//   D4RL ends the episodes behind a terminal row one step earlier than the environment does.) The
//   next observation is the observation of the next row; rows that end by time-out and the last row
//   are dropped. A terminal row stays; its next observation is the first observation of the next
//   episode: bootstrapping never reads it, a model of the dynamics must not, and discriminators see
//   it, as with D4RL's own loader. The timeouts column marks the last kept row of an episode that
//   timed out, so that episodes can still be told apart.
// Pure functions; any thread.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "proto/base/status.h"

namespace b4mrl {

enum class TransitionRule { kStored, kD4rl };
std::string_view TransitionRuleName(TransitionRule rule);  // "stored", "d4rl"
// Parses "stored" or "d4rl"; "" is the default, kStored.
Result<TransitionRule> ParseTransitionRule(std::string_view name);

// Whether `row` is the last row of its episode: a terminal, a time-out or the last row of the data.
inline bool EndsEpisode(std::span<const uint8_t> terminals, std::span<const uint8_t> timeouts,
                        uint64_t row) {
  return terminals[row] != 0 || timeouts[row] != 0 || row + 1 == terminals.size();
}

// Whether kD4rl keeps `row`, whose next observation is then the observation of row + 1.
inline bool D4rlKeeps(std::span<const uint8_t> timeouts, uint64_t row) {
  return row + 1 < timeouts.size() && timeouts[row] == 0;
}
// The value that kD4rl gives to the timeouts column of a kept row.
inline bool D4rlTimeout(std::span<const uint8_t> terminals, std::span<const uint8_t> timeouts,
                        uint64_t row) {
  return terminals[row] == 0 && timeouts[row + 1] != 0;
}

// The timeouts column for a file without one: an episode ends after `limit` rows without a
// terminal.
std::vector<uint8_t> InferTimeouts(std::span<const uint8_t> terminals, uint64_t limit);
inline constexpr uint64_t kD4rlStepLimit = 1000;

}  // namespace b4mrl
