// What MOPO and HyMOPO have in common: SAC on short rollouts in a learned model. mopo.cc and
// hymopo.cc put the steps below together.
//
// D_model keeps the rollouts of the last `model-retain` cycles. They are a function of the policies
// that made them, so a checkpoint keeps those policies, and resuming rolls them out again. With
// `rollout-lag` 1 a cycle uses the rollouts of the policy one cycle ago, which the daemon simulates
// while this process updates; with 0 it waits for the present policy's. The ensemble, too, is named
// by a checkpoint and not in it: ensemble.h5 in the run's folder.
// Thread rule: one thread, but for rollouts under way (model/model_rollout.h).
#pragma once

#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "algorithms/base/learner.h"
#include "algorithms/cores/sac_core.h"
#include "algorithms/experience/batch_buffer.h"
#include "algorithms/experience/replay_buffer.h"
#include "algorithms/experience/training_dataset.h"
#include "algorithms/model/dynamics_ensemble.h"
#include "algorithms/model/model_data.h"
#include "algorithms/model/model_rollout.h"

namespace b4mrl {

class ModelBased : public Learner {
 public:
  // What a learner is made of, opened by Open.
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

  Status Save(CheckpointWriter& writer) override;
  Status Load(CheckpointReader& reader) override;
  bool outlives_daemon() const override { return true; }
  std::string dataset_sha256() const override { return dataset_.sha256(); }

 protected:
  // Trains f on `data`, or takes up the ensemble that was trained alike. Then Update may follow.
  Status TrainModel(const ModelData& data, Progress& progress);
  // Every `rollout-every` updates, at the start of a cycle: D_model <- D_model + rollouts of pi.
  // What Save stores changes only after the daemon's last answer.
  Status RollOut(MetricMeans& metrics);
  // A batch for SAC: `real`, and the rest from D_model. Real rows keep the dataset's reward; the
  // penalty is in the model's rows. Valid until the next call.
  TransitionBatch<float> FillBatch(const TransitionRows& real);
  PolicyWeights MaskedPolicy() const;

  const LearnerContext& context_;
  SacCore<float> core_;                         // pi and Q
  DynamicsEnsemble<float> ensemble_;            // f
  TrainingDataset dataset_;                     // D
  std::optional<RemoteEnvironment> simulator_;  // T_sim

 private:
  // One cycle's rollouts in D_model.
  struct Generation {
    uint64_t cycle;
    std::vector<float> policy;  // FlattenPolicy of the policy that made it
    uint64_t first_record;      // in D_model
  };
  Result<Generation> BeginRollout(uint64_t cycle, const PolicyWeights& policy);
  void Keep(Generation generation);
  uint64_t updates() const { return static_cast<uint64_t>(core_.updates()); }

  const uint64_t rollout_every_;
  const bool lag_;
  std::string ensemble_key_;
  ModelRollout rollout_;
  ReplayBuffer pool_;                   // D_model
  std::deque<Generation> generations_;  // in D_model, oldest first
  std::optional<Generation> pending_;   // under way, with lag 1
  BatchBuffer batch_;                   // real rows first
  std::vector<float> action_scale_;
};

}  // namespace b4mrl
