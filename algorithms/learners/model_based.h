// What MOPO and HyMOPO share: SAC on short rollouts in a learned model. mopo.cc and hymopo.cc
// prepare the data of that model.
//
// D_model keeps the rollouts of the last `model-retain` cycles. They are a function of the policies
// that made them, so a checkpoint keeps the policies, and resuming rolls them out again. With
// `rollout-lag` 0 a cycle waits for rollouts of the present policy. With 1 it uses rollouts of the
// previous cycle's policy, which were made on a thread of their own, and in HyMOPO by the daemon,
// during the previous cycle's updates; when they are ready changes no bit of a run. A
// checkpoint stores only the key of the ensemble, which lies in ensemble.h5 of the run's folder.
// Thread rule: one thread, but for rollouts under way (model/model_rollout.h).
#pragma once

#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "algorithms/base/learner.h"
#include "algorithms/cores/sac_core.h"
#include "algorithms/experience/batch_buffer.h"
#include "algorithms/experience/replay_buffer.h"
#include "algorithms/experience/training_dataset.h"
#include "algorithms/model/dynamics_ensemble.h"
#include "algorithms/model/model_data.h"
#include "algorithms/model/model_rollout.h"
#include "proto/base/clock.h"

namespace b4mrl {

class ModelBased : public Learner {
 public:
  // The parts of a learner, made by Open.
  struct Parts {
    SacCore<float> core;
    DynamicsEnsemble<float> ensemble;
    TrainingDataset dataset;
    std::optional<RemoteEnvironment> simulator;
    std::optional<Termination> termination;
    ReplayBuffer pool;
  };
  // `uses_simulator`: the model's step is o' = o'_sim + delta, o'_sim = T_sim(o, a); otherwise
  // o' = o + delta.
  static Result<Parts> Open(const LearnerContext& context, bool uses_simulator);
  ModelBased(const LearnerContext& context, Parts parts);

  Status Update(MetricMeans& metrics) override;
  PolicyWeights Policy() const override;
  Status Save(CheckpointWriter& writer) override;
  Status Load(CheckpointReader& reader) override;
  double seconds_taken_up() const override { return ensemble_seconds_before_; }
  bool outlives_daemon() const override { return true; }
  DatasetIdentity dataset_identity() const override { return dataset_.identity(); }

 protected:
  // Trains f on `data`, or loads an ensemble that was trained with equal data and options. To be
  // called before the first Update.
  Status TrainModel(const ModelData& data, Progress& progress);

  const LearnerContext& context_;
  TrainingDataset dataset_;                     // D
  std::optional<RemoteEnvironment> simulator_;  // T_sim

 private:
  // Every `rollout-every` updates, at the start of a cycle: D_model <- D_model + rollouts of pi.
  // The state that Save stores changes only after the daemon's last answer, but for `pending_`: a
  // rollout that was begun is begun again.
  Status RollOut(MetricMeans& metrics);
  // A batch for SAC: the rows `real`, filled up with rows from D_model. Real rows keep the
  // dataset's reward; the model's rewards include the penalty. Valid until the next call.
  TransitionBatch<float> FillBatch(const TransitionRows& real);
  // One cycle's rollouts in D_model.
  struct Generation {
    uint64_t cycle;
    std::vector<float> policy;  // FlattenPolicy of the policy that was rolled out
    uint64_t first_record;      // number of its first record in D_model
  };
  Result<Generation> BeginRollout(uint64_t cycle, const PolicyWeights& policy);
  void Keep(Generation generation);
  uint64_t updates() const { return static_cast<uint64_t>(core_.updates()); }

  SacCore<float> core_;               // pi and Q
  DynamicsEnsemble<float> ensemble_;  // f
  const uint64_t rollout_every_;
  const bool lag_;
  std::string ensemble_key_;
  double ensemble_seconds_before_ = 0;  // of training in earlier sessions without a checkpoint
  ModelRollout rollout_;
  Clock::time_point last_rollout_ = Clock::now();  // its beginning, or the session's
  ReplayBuffer pool_;                              // D_model
  std::deque<Generation> generations_;             // in D_model, oldest first
  std::optional<Generation> pending_;              // being rolled out
  BatchBuffer batch_;                              // dataset rows, then rows of D_model
  std::vector<float> action_scale_;
};

}  // namespace b4mrl
