// Whole episodes of a stochastic policy, as a dataset: `b4mrl dataset make`.
//
// Episode e starts from the environment seed RoleSeed(seed, "episode", e) and draws its actions
// from RoleSeed(seed, "behaviour", e), so its rows depend on nothing else: not on which lane runs
// it, what runs beside it, or how many workers and threads the daemon has. Episodes are written in
// the order of their numbers and the last one is cut at `rows`. Two groups of lanes take turns: one
// is simulated while actions for the other are inferred. Thread rule: one thread.
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
  uint32_t lanes_max = 64;  // largest number of lanes of each group
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
