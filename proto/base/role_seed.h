// The seeds within a run: one for each use of random numbers. A pure function; any thread.
#pragma once

#include <cstdint>
#include <string_view>

#include "proto/base/rng.h"

namespace b4mrl {

// The seed of use `index` of `role` ("train-lane", "explore", "rollout") within a run. Episode i of
// every evaluation with seed s starts from RoleSeed(s, "evaluation", i).
inline uint64_t RoleSeed(uint64_t run_seed, std::string_view role, uint64_t index = 0) {
  return MixSeeds(MixSeeds(run_seed, HashName(role)), index);
}

}  // namespace b4mrl
