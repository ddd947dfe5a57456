// Short rollouts in a learned model, in large batches: the hot path of MOPO and HyMOPO.
//
// From each start row, `horizon` steps:   a ~ pi(o);   one elite f_i at random;
//   (delta, r) ~ f_i(o, a);   r~ = r - penalty * max_i |std_i(o, a)|
//   MOPO:    o' = o + delta
//   HyMOPO:  o' = o'_sim + delta,  o'_sim = T_sim(o, a), simulated by the daemon
// A row also ends where the termination function says that o' ends the episode; without a
// termination function, where the simulator reports that o'_sim ends it. A row whose query or
// prediction is not finite is dropped and counted. Ended rows take no part in later steps.
//
// Rows are processed in chunks. While the daemon simulates several chunks, the thread of the
// rollout evaluates policy and ensemble for other chunks; it can, since the correction depends on o
// and a only, not on o'_sim.
//
// Noise is a function of its address, never of timing. Address of the noise of policy and model:
// (cycle, step, start row); of the simulator's noise: (cycle, step, chunk, position among the
// chunk's surviving rows). Transitions are appended in chunk order. So results depend neither on
// when answers arrive nor on the daemon's threads. Dimensions that the dataset hides stay zero in
// o', as the policy always sees them.
//
// Thread rule: one thread calls. From Begin to Finish a thread of this object does the work, so
// that the caller's updates overlap with inference and not only with the simulator. Meanwhile no
// other thread may use the simulator session (num_envs 0) or the ensemble, except to read the
// ensemble's arrays. Session and ensemble outlive the object.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <thread>
#include <vector>

#include "algorithms/experience/replay_buffer.h"
#include "algorithms/model/dynamics_ensemble.h"
#include "algorithms/model/termination.h"
#include "algorithms/policy/inference.h"
#include "client/remote_environment.h"
#include "proto/base/status.h"

namespace b4mrl {

struct ModelRolloutOptions {
  int observation_size = 0;
  int action_size = 0;
  int horizon = 5;
  double penalty = 0;        // factor on max_i |std_i(o, a)|
  int chunk_rows = 2'000;    // at most limits::kMaxQueryRows
  int chunks_in_flight = 6;  // most chunks at the daemon at once
  uint64_t seed = 0;
  std::vector<float> action_scale;         // largest action in the environment's units
  std::vector<float> mask;                 // of an observation: 1 seen, 0 hidden; empty: all seen
  std::optional<Termination> termination;  // without it, the simulator reports the end of episodes
};

struct RolloutCounts {
  uint64_t rows = 0;             // transitions made
  uint64_t invalid_rows = 0;     // rows dropped: no answer, or a number not finite
  uint64_t terminated_rows = 0;  // transitions that ended an episode
  double reward_sum = 0;         // sum of the rewards r~, penalty included, over `rows`
};

class ModelRollout {
 public:
  // `simulator`: nullptr for MOPO, whose options must then have a termination function.
  ModelRollout(ModelRolloutOptions options, RemoteEnvironment* simulator,
               DynamicsEnsemble<float>* ensemble);
  ~ModelRollout();

  // Starts rollout number `cycle` from `starts` (row-major observations) under `policy`. Needs
  // done().
  Status Begin(uint64_t cycle, std::vector<float> starts, const PolicyWeights& policy);
  bool done() const { return !worker_.joinable(); }
  // Waits for the end of the rollout, then appends all transitions to `pool`, ordered by chunk,
  // then by step, then by start row.
  Result<RolloutCounts> Finish(ReplayBuffer& pool);

 private:
  struct Chunk;
  Status RollOut(const std::stop_token& stop);
  Status Advance();
  Status Fill();
  Status BeginStep(Chunk& chunk);
  void DrawNoise(const char* purpose, const Chunk& chunk, MatrixView<float> noise) const;
  void SampleActions(Chunk& chunk);
  Status SendQuery(Chunk& chunk);
  void SampleModel(Chunk& chunk);
  Status ReceiveNext(Chunk& chunk);
  void CompleteStep(Chunk& chunk);
  bool CompleteRow(Chunk& chunk, int row);

  ModelRolloutOptions options_;
  RemoteEnvironment* simulator_;
  DynamicsEnsemble<float>* ensemble_;
  std::optional<FixedOrderPolicy> policy_;
  std::vector<float> starts_;
  uint64_t cycle_ = 0;
  int next_start_ = 0;                         // first start row that no chunk has taken
  std::deque<std::unique_ptr<Chunk>> active_;  // in the order in which their requests were sent
  std::vector<std::unique_ptr<Chunk>> finished_;
  // Inputs of one step of one chunk.
  MatrixBuffer<float> observations_, actions_, action_noise_, model_noise_;
  std::vector<int> members_;
  Status worker_status_;
  std::jthread worker_;  // last member: joined before the members that it uses are destroyed
};

}  // namespace b4mrl
