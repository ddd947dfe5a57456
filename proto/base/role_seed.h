// The seeds within a run: one for each use of random numbers. A pure function; any thread.
#pragma once

#include <algorithm>
#include <cstdint>
#include <string_view>

#include "proto/base/rng.h"

namespace b4mrl {

// The seed of use `index` of `role` ("train-lane", "explore", "rollout") within a run. Episode i of
// every evaluation with seed s starts from RoleSeed(s, "evaluation", i).
inline uint64_t RoleSeed(uint64_t run_seed, std::string_view role, uint64_t index = 0) {
  return MixSeeds(MixSeeds(run_seed, HashName(role)), index);
}

// The seed to open a session of a run with whose resets give each of its `lanes`, one or more, a
// seed of its own. Before those, lane i has the session's seed + i, which must be below 2^64.
inline uint64_t SessionSeed(uint64_t run_seed, uint32_t lanes) {
  return std::min(run_seed, UINT64_MAX - (lanes - 1));
}

}  // namespace b4mrl
