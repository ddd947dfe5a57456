// MOPO: model-based offline policy optimisation (Yu et al. 2020), as the paper's authors ran it
// (junming-yang/mopo). Options name what the official code does otherwise.
//
//   D        dataset of (o, a, r, o', d)       D_model  what rollouts in the model produced lately
//   f        ensemble of Gaussian networks (o, a) -> (delta, r)         (rl/dynamics_ensemble.h)
//   pi       SAC's policy                                                       (rl/sac_core.h)
//
//   train f on targets [o' - o, r] by likelihood                      (rl/ensemble_training.h)
//   repeat:  every `rollout-every` updates: `rollout-rows` starts from D, `horizon` steps of
//              a ~ pi(o);  (delta, r) ~ f_i(o, a), i a random elite;  o' = o + delta;
//              r~ = r - `penalty` * max_i |std_i(o, a)|, until the termination function says that
//              o' ends the episode; add (o, a, r~, o', d) to D_model       (rl/model_rollout.h)
//            one SAC update on a batch, `real-ratio` of it from D, the rest from D_model
//
// The loop itself is HyMOPO's too: rl/model_based.cc.
#include <vector>

#include "algorithms/learners/learners.h"
#include "algorithms/learners/model_based.h"
#include "algorithms/learners/model_based_options.h"

namespace b4mrl {
namespace {

constexpr std::string_view kPenaltySource =
    "junming-yang/mopo, where it is fixed; official, by dataset: 0.5 to 5 (HalfCheetah/medium 1)";
constexpr std::string_view kHorizonSource =
    "junming-yang/mopo; official, by dataset: 1 or 5 (HalfCheetah/medium 1)";
constexpr EnvironmentDefault kHorizons[] = {{"Walker2d", 1}};

constexpr Hyperparameter kOwn[] = {
    {"penalty", 1, 0, 1e3, false, "weight of the ensemble's largest deviation", "", kPenaltySource},
    {"horizon", 5, 1, 1000, true, "of a rollout", "steps", kHorizonSource, "", kHorizons},
};

Result<ModelData> ReadTargets(const LearnerContext& context, RemoteDataset& dataset,
                              RemoteEnvironment*, Progress& progress) {
  return ReadChanges(context, dataset, progress);
}

}  // namespace

std::span<const Hyperparameter> MopoHyperparameters() {
  static const std::vector<Hyperparameter> kTable = WithModelBasedHyperparameters(kOwn);
  return kTable;
}

Result<std::unique_ptr<Learner>> CreateMopo(const LearnerContext& context) {
  return CreateModelBased(context, {.uses_simulator = false, .read_targets = ReadTargets});
}

}  // namespace b4mrl
