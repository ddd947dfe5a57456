// HyMOPO: hybrid model-based policy optimisation (the B4MRL paper's algorithm 1, on MOPO's
// hyperparameters as run there).
//
//   D        dataset of (o, a, r, o', d)       D_model  what rollouts produced lately
//   T_sim    the imperfect simulator, asked by Query
//   f        ensemble of Gaussian correction networks (o, a) -> (delta, r)
//                                                                       (rl/dynamics_ensemble.h)
//   pi       SAC's policy                                                       (rl/sac_core.h)
//
//   pre-pass:  o'_sim <- T_sim(o, a) for every row of D                       (rl/model_data.h)
//   train f on targets [o' - o'_sim, r] by likelihood                  (rl/ensemble_training.h)
//   repeat:  every `rollout-every` updates: `rollout-rows` starts from D, `horizon` steps of
//              a ~ pi(o);  (delta, r) ~ f_i(o, a), i a random elite;  o' = T_sim(o, a) + delta;
//              r~ = r - `penalty` * max_i |std_i(o, a)|, until the termination function says that
//              o' ends the episode; add (o, a, r~, o', d) to D_model       (rl/model_rollout.h)
//            one SAC update on a batch, `real-ratio` of it from D, the rest from D_model
//
// The loop itself is MOPO's too: rl/model_based.cc.
#include <vector>

#include "algorithms/learners/learners.h"
#include "algorithms/learners/model_based.h"
#include "algorithms/learners/model_based_options.h"
#include "proto/base/limits.h"

namespace b4mrl {
namespace {

constexpr Hyperparameter kOwn[] = {
    {"penalty", 0, 0, 1e3, false, "weight of the ensemble's largest deviation", "", "the paper"},
    {"horizon", 5, 1, 1000, true, "of a rollout", "steps",
     "the paper, for HalfCheetah; ours elsewhere"},
    {"rollout-lag", 0, 0, 1, true, "0: roll out the present policy, 1: that of one cycle ago",
     "cycles", "ours: 0 is the paper's algorithm, 1 lets simulation and updates overlap"},
    {"chunk-rows", 2000, 1, limits::kMaxQueryRows, true, "of one query", "rows",
     "ours, by measurement"},
    {"chunks-in-flight", 6, 1, limits::kMaxRequestsInFlight, true, "at the daemon at once",
     "queries", "ours, by measurement"},
};

Result<ModelData> ReadTargets(const LearnerContext& context, RemoteDataset& dataset,
                              RemoteEnvironment* simulator, Progress& progress) {
  const uint64_t query_seed = RoleSeed(context.seed, "pre-pass");
  return QueryCorrections(context, dataset, *simulator, query_seed, progress);
}

}  // namespace

std::span<const Hyperparameter> HymopoHyperparameters() {
  static const std::vector<Hyperparameter> kTable = WithModelBasedHyperparameters(kOwn);
  return kTable;
}

Result<std::unique_ptr<Learner>> CreateHymopo(const LearnerContext& context) {
  return CreateModelBased(context, {.uses_simulator = true, .read_targets = ReadTargets});
}

}  // namespace b4mrl
