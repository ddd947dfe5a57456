// The learner that MOPO and HyMOPO are: SAC on short rollouts in a learned model.
//
//   D        dataset of (o, a, r, o', d)
//   f        ensemble of Gaussian networks (o, a) -> (delta, r)         (rl/dynamics_ensemble.h)
//   D_model  what rollouts in the model produced lately
//   pi       SAC's policy                                                       (rl/sac_core.h)
//
//   train f on D, with the targets of the algorithm in question         (rl/ensemble_training.h)
//   repeat:  every `rollout-every` updates: `rollout-rows` starts from D, `horizon` steps in the
//            model under pi; add to D_model                                (rl/model_rollout.h)
//            one SAC update on a batch, `real-ratio` of it from D, the rest from D_model
//
// D_model keeps the rollouts of the last `model-retain` cycles. They are a function of the policies
// that made them, so a checkpoint keeps those policies, and resuming rolls them out again. With
// `rollout-lag` 1 a cycle uses the rollouts of the policy one cycle ago, which the daemon simulates
// while this process updates; with 0 it waits for the present policy's. The ensemble, too, is named
// by a checkpoint and not in it: ensemble.h5 in the run's folder.
#pragma once

#include <memory>

#include "algorithms/base/learner.h"
#include "algorithms/model/model_data.h"

namespace b4mrl {

// Where an algorithm differs. The model's step is o' = o + delta, or with a simulator o'_sim +
// delta, o'_sim = T_sim(o, a).
struct ModelBasedAlgorithm {
  bool uses_simulator;
  // (o, a) of every row of D, and what f is to predict there. `simulator`: nullptr without.
  Result<ModelData> (*read_targets)(const LearnerContext& context, RemoteDataset& dataset,
                                    RemoteEnvironment* simulator, Progress& progress);
};

Result<std::unique_ptr<Learner>> CreateModelBased(const LearnerContext& context,
                                                  const ModelBasedAlgorithm& algorithm);

}  // namespace b4mrl
