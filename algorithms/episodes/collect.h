// Whole episodes of a stochastic policy, as a dataset: `b4mrl dataset make`.
//
// Episode e starts from the environment seed RoleSeed(seed, "episode", e) and draws its actions
// from RoleSeed(seed, "behaviour", e), so its rows do not depend on the lane that runs it, on other
// episodes, or on the numbers of the daemon's workers and threads. Episodes are written in the
// order of their numbers, and the last episode is cut so that there are `rows` rows. Two groups of
// lanes take turns: while the daemon simulates one group, actions for the other are inferred.
// Thread rule: one thread.
#pragma once

#include <cstdint>
#include <string>

#include "algorithms/base/progress.h"
#include "algorithms/policy/agent_policy.h"
#include "client/client.h"
#include "data/d4rl/dataset_file_writer.h"
#include "proto/base/status.h"

namespace b4mrl {

struct CollectOptions {
  std::string environment;
  uint64_t rows = 1'000'000;
  uint64_t seed = 0;
  uint32_t lanes_max = 64;  // largest number of lanes in each of the two groups
};

struct CollectSummary {
  uint64_t rows = 0;
  uint64_t episodes = 0;  // episodes written, including a last one that was cut
  uint64_t whole_episodes = 0;
  double mean_return = 0;  // over whole episodes
};

// Appends exactly `rows` rows; the writer's columns include action_log_probs. kInvalidArgument when
// the policy is not stochastic or does not fit the environment.
Result<CollectSummary> Collect(const CollectOptions& options, const AgentPolicy& policy,
                               Client& client, DatasetWriter& writer, Progress& progress);

}  // namespace b4mrl
