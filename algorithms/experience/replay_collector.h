// Collects an online or hybrid learner's experience: acts in the lanes of a simulator session and
// keeps every transition in a replay buffer.
//
// A vector step takes one step in every lane of the simulator and appends as many transitions to
// the replay file `replay.bin` of the run's folder. The policy sees the last `history_length`
// observations of a lane, stacked. When an episode ends, the lane begins the next one at once. The
// last transition of an episode leads to its final observation, and is `terminated` only if the
// task's rule ended the episode: after the step limit, the value bootstraps. Steps that the daemon
// or the physics engine gave up have no outcome to learn from and are left out.
//
// Hyperparameters read, with the value where a table lacks them: lanes (1), replay-capacity (1e6),
// exploration-noise (0). Random numbers are functions of (run seed, vector step), so that a resumed
// run needs only the number of vector steps. Thread rule: one thread. Ownership: the context
// outlives the collector. Errors: those of the session and of the replay file.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "algorithms/base/learner.h"
#include "algorithms/experience/replay_buffer.h"
#include "algorithms/policy/observation_history.h"
#include "client/remote_environment.h"
#include "proto/base/clock.h"

namespace b4mrl {

class ReplayCollector {
 public:
  // Opens the session. `mask` says what the policy may see of one observation (1 seen, 0 hidden;
  // empty: everything), which for a hybrid learner is what its dataset shows. Without a mask the
  // policy sees what the simulator shows.
  static Result<ReplayCollector> Open(const LearnerContext& context,
                                      std::optional<std::vector<float>> mask = {});

  // Begins a fresh run: an empty replay file, and an episode in every lane. A resumed run calls
  // Load instead.
  Status Start();
  Status Save(CheckpointWriter& writer);
  Status Load(CheckpointReader& reader);

  // Takes vector steps with uniformly random actions until the replay file holds `transitions`
  // records, or the context's `stop` is set. kFailedPrecondition after many vector steps in a row
  // that stored nothing.
  Status WarmUp(uint64_t transitions, Progress& progress);
  // One vector step under `policy`. Actions are sampled from it, or, where it is deterministic, are
  // its own plus N(0, exploration-noise), clipped to [-1, 1]. The return of each episode that ends
  // becomes the metric "episodic_return", unless the episode began in the warm-up.
  Status Step(const FixedOrderPolicy& policy, MetricMeans& metrics);

  // Takes vector steps under `policy` until the lanes have taken at least `steps` steps together.
  Status Collect(const PolicyWeights& policy, uint64_t steps, MetricMeans& metrics);

  // Keeps the session from ending by its lease (client/remote_environment.h). To be called often
  // by a learner that takes no step for long; asks the daemon for something now and then.
  Status KeepSession();

  uint32_t lanes() const { return count_; }
  uint64_t environment_steps() const { return vector_steps_ * count_; }
  // Length of the policy's input: all observations of a history together.
  int observation_size() const { return replay_options_.observation_size; }
  // `policy` with the mask of its input.
  PolicyWeights WithInputs(PolicyWeights policy) const;
  const ReplayBuffer& replay() const { return *replay_; }  // only after Start or Load

 private:
  ReplayCollector(const LearnerContext& context, RemoteEnvironment simulator,
                  std::vector<float> mask);

  std::string ReplayPath() const { return context_->folder + "/replay.bin"; }
  void Explore(const FixedOrderPolicy& policy);
  Result<StepOutcome> StepAndStore();
  Status Store(int lane, const StepOutcome& outcome, std::span<const float> final_observation);
  // The observation with hidden dimensions set to 0; valid until the next call.
  std::span<const float> Visible(std::span<const float> observation);

  const LearnerContext* context_;
  RemoteEnvironment simulator_;
  std::vector<float> mask_;  // of one observation; empty: nothing hidden
  std::vector<float> action_scale_;
  uint32_t count_;
  float exploration_noise_;
  ReplayBuffer::Options replay_options_;

  std::optional<ReplayBuffer> replay_;
  std::optional<FixedOrderPolicy> acting_;  // the policy of the last Collect
  ObservationHistory histories_;            // the policy's input in every lane
  std::vector<float> previous_;             // one lane's history before a step
  std::vector<float> visible_;              // one observation, as returned by Visible
  MatrixBuffer<float> actions_;             // in [-1, 1]
  MatrixBuffer<float> scaled_actions_;      // actions_ in the environment's units
  MatrixBuffer<float> noise_;
  Clock::time_point asked_ = Clock::now();  // when the session last got a request
  uint64_t vector_steps_ = 0;
  uint64_t warm_up_steps_ = 0;  // vector steps of the warm-up
};

}  // namespace b4mrl
