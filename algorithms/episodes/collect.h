// Whole episodes of a behaviour policy, as rows of a dataset: `b4mrl dataset make`.
//
// Episode e starts from the environment seed RoleSeed(seed, "episode", e) and draws its actions
// from RoleSeed(seed, "behaviour", e), so its rows do not depend on the lane that runs it, on other
// episodes, or on the numbers of the daemon's workers and threads. Episodes are written in the
// order of their numbers. Two groups of lanes take turns: while the daemon simulates one group,
// actions for the other are inferred. Thread rule: one thread.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "algorithms/base/progress.h"
#include "algorithms/episodes/behaviour.h"
#include "algorithms/episodes/recorder.h"
#include "client/client.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

struct CollectOptions {
  std::string environment;
  std::vector<NamedArgument> simulator;  // perturbations of the recorded environment
  uint64_t rows = 1'000'000;
  // Whether the rows end with the last episode that fits, so that there are fewer of them, instead
  // of with a part of an episode.
  bool whole_episodes = false;
  uint64_t seed = 0;
  uint32_t lanes_max = 64;  // largest number of lanes in each of the two groups
};

// Seed of the environment in which episode `episode` of a recording with `seed` starts.
uint64_t EpisodeSeed(uint64_t seed, uint64_t episode);

// Appends `rows` rows, which may be none, to `recorder`, whose columns include action_log_probs.
// Errors: those of Client::Make; kFailedPrecondition when the simulator gave up a step.
Status Collect(const CollectOptions& options, const Behaviour& behaviour, Client& client,
               Recorder& recorder, Progress& progress);

}  // namespace b4mrl
