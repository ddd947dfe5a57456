// Collects an online or hybrid learner's experience: acts in the lanes of a simulator session and
// keeps every transition in a replay buffer.
//
// A vector step takes one step in every lane of the simulator and appends as many transitions to
// the replay file `replay.bin` of the run's folder. The policy sees the last `history_length`
// observations of a lane, stacked. An episode that ends is followed by the next one at once; its
// last transition leads to the observation it ended in, and is `terminated` only if the task's rule
// ended it: the value of an episode that ends by the step limit bootstraps. Steps that the daemon
// or the physics engine gave up have no outcome to learn from and are left out.
//
// Hyperparameters read, with the value where a table lacks them: lanes (1), replay-capacity (1e6),
// exploration-noise (0). Random numbers are functions of (run seed, vector step), so that a resumed
// run needs only the counter. Thread rule: one thread. Ownership: the context outlives it. Errors:
// those of the session and of the replay file.
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

namespace b4mrl {

class ReplayCollector {
 public:
  // Opens the session. `mask` says what the policy may see of one observation (1 seen, 0 hidden;
  // empty: everything), as the dataset of a hybrid learner shows it; without one it sees what the
  // simulator shows.
  static Result<ReplayCollector> Open(const LearnerContext& context,
                                      std::optional<std::vector<float>> mask = {});

  // A fresh run: an empty replay file, an episode begun in every lane. Load takes its place when a
  // run is resumed.
  Status Start();
  Status Save(CheckpointWriter& writer);
  Status Load(CheckpointReader& reader);

  // Vector steps of uniform actions until the replay file holds `transitions`, or the context's
  // `stop` is set. kFailedPrecondition after many steps in a row that could not be stored.
  Status WarmUp(uint64_t transitions, Progress& progress);
  // One vector step under `policy`: sampled from it, or, where it is deterministic, its action plus
  // N(0, exploration-noise), clipped to [-1, 1]. Returns of episodes that end become the metric
  // "episodic_return", but for those that began in the warm-up.
  Status Step(const FixedOrderPolicy& policy, MetricMeans& metrics);

  // Vector steps under one policy until the lanes have taken at least `steps` steps together.
  Status Collect(const PolicyWeights& policy, uint64_t steps, MetricMeans& metrics);

  uint32_t lanes() const { return count_; }
  uint64_t environment_steps() const { return vector_steps_ * count_; }
  // Of what the policy sees: all observations of a history together.
  int observation_size() const { return replay_options_.observation_size; }
  // `policy` with the mask of what it sees.
  PolicyWeights WithInputs(PolicyWeights policy) const;
  const ReplayBuffer& replay() const { return *replay_; }  // only after Start or Load

 private:
  ReplayCollector(const LearnerContext& context, RemoteEnvironment simulator,
                  std::vector<float> mask);

  std::string ReplayPath() const { return context_->folder + "/replay.bin"; }
  void Explore(const FixedOrderPolicy& policy);
  Result<StepOutcome> StepAndStore();
  Status Store(int lane, const StepOutcome& outcome, std::span<const float> final_observation);
  // The observation without what the mask hides; valid until the next call.
  std::span<const float> Visible(std::span<const float> observation);

  const LearnerContext* context_;
  RemoteEnvironment simulator_;
  std::vector<float> mask_;  // of one observation; empty: nothing hidden
  std::vector<float> action_scale_;
  uint32_t count_;
  float exploration_noise_;
  ReplayBuffer::Options replay_options_;

  std::optional<ReplayBuffer> replay_;
  ObservationHistory histories_;        // what the policy sees in every lane
  std::vector<float> previous_;         // one lane's, before a step
  std::vector<float> visible_;          // one observation
  MatrixBuffer<float> actions_;         // in [-1, 1]
  MatrixBuffer<float> scaled_actions_;  // the same in the environment's units
  MatrixBuffer<float> noise_;
  uint64_t vector_steps_ = 0;
  uint64_t warm_up_steps_ = 0;  // of them
};

}  // namespace b4mrl
