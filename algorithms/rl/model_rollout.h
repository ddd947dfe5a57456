// Short rollouts in a corrected simulator, in large batches: HyMOPO's hot path.
//
// From each start row, `horizon` steps:   a ~ pi(o);   o'_sim = T_sim(o, a), asked of the daemon;
//   one elite f_i at random;   (delta, r) ~ f_i(o, a);   o' = o'_sim + delta;
//   r~ = r - penalty * max_i |std_i(o, a)|
// Rows go in chunks. Several chunks are at the daemon at any time, and while it simulates, this
// thread infers the policy and the ensemble for others: the correction needs o and a only, not
// o'_sim. A row whose query or correction is not finite, and whatever would follow it, is dropped
// and counted.
//
// All noise is addressed by (cycle, step, row) and chunks end in the order in which they began, so
// results depend neither on how Advance calls are spread over time nor on the daemon's threads; on
// the chunk size only through the last bits of the ensemble's matrix products. Dimensions that the
// dataset hides stay zero in o', as the policy will meet them. Thread rule: one thread. The
// simulator session (num_envs 0) and the ensemble outlive the object.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "algorithms/nn/inference.h"
#include "algorithms/rl/dynamics_ensemble.h"
#include "algorithms/rl/replay_buffer.h"
#include "client/remote_environment.h"
#include "proto/base/status.h"

namespace b4mrl {

struct ModelRolloutOptions {
  int observation_size = 0;
  int action_size = 0;
  int horizon = 5;
  double penalty = 0;
  int chunk_rows = 2'000;  // at most limits::kMaxQueryRows
  int chunks_in_flight = 6;
  uint64_t seed = 0;
  std::vector<float> action_scale;
  std::vector<float> mask;  // of an observation: 1 seen, 0 hidden; empty: all seen
};

struct RolloutCounts {
  uint64_t rows = 0;          // transitions made
  uint64_t invalid_rows = 0;  // dropped
  double reward_sum = 0;      // after the penalty, over `rows`
};

class ModelRollout {
 public:
  ModelRollout(ModelRolloutOptions options, RemoteEnvironment* simulator,
               DynamicsEnsemble<float>* ensemble);
  ~ModelRollout();

  // Starts rollout number `cycle` from `starts` (row-major observations) under `policy`. Needs
  // done().
  Status Begin(uint64_t cycle, std::vector<float> starts, const PolicyWeights& policy);
  // One step of one chunk. Does nothing when done().
  Status Advance();
  bool done() const { return active_.empty(); }
  // Advances to the end, then appends all transitions to `pool`, in the order of rows within
  // chunks.
  Result<RolloutCounts> Finish(ReplayBuffer& pool);

 private:
  struct Chunk;
  Status Fill();
  Status SendStep(Chunk& chunk);
  Status ReceiveStep(Chunk& chunk);
  void DrawNoise(const char* purpose, const Chunk& chunk, MatrixView<float> noise) const;
  void SampleCorrection(Chunk& chunk);
  void ApplyCorrection(Chunk& chunk);

  ModelRolloutOptions options_;
  RemoteEnvironment* simulator_;
  DynamicsEnsemble<float>* ensemble_;
  std::optional<FixedOrderPolicy> policy_;
  std::vector<float> starts_;
  uint64_t cycle_ = 0;
  int next_start_ = 0;                         // first start row that no chunk has taken
  std::deque<std::unique_ptr<Chunk>> active_;  // in the order in which their requests were sent
  std::vector<std::unique_ptr<Chunk>> finished_;
};

}  // namespace b4mrl
