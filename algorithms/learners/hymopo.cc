// HyMOPO: hybrid model-based policy optimisation (the B4MRL paper's algorithm 1, with the MOPO
// hyperparameters of the paper's runs).
//
//   D        dataset of (o, a, r, o', d)       D_model  transitions of recent rollouts
//   T_sim    the imperfect simulator, which Query requests evaluate
//   f        ensemble of Gaussian correction networks (o, a) -> (delta, r)
//                                                                    (model/dynamics_ensemble.h)
//   pi       SAC's policy                                                    (cores/sac_core.h)
//
//   pre-pass:  o'_sim <- T_sim(o, a) for every row of D                    (model/model_data.h)
//   train f on targets [o' - o'_sim, r] by likelihood                 (model/ensemble_store.h)
//   repeat:  every `rollout-every` updates: `rollout-rows` starts from D, `horizon` steps of
//              a ~ pi(o);  (delta, r) ~ f_i(o, a), i a random elite;  o' = T_sim(o, a) + delta;
//              r~ = r - `penalty` * max_i |std_i(o, a)|, until the termination function says that
//              o' ends the episode; add (o, a, r~, o', d) to D_model    (model/model_rollout.h)
//            one SAC update on a batch, `real-ratio` of it from D, the rest from D_model
//
// learners/model_based.h has the steps, which MOPO shares.
#include <memory>
#include <utility>

#include "algorithms/learners/model_based.h"
#include "algorithms/learners/model_based_options.h"
#include "proto/base/limits.h"

namespace b4mrl {
namespace {

class Hymopo final : public ModelBased {
 public:
  using ModelBased::ModelBased;

  Status Prepare(Progress& progress) override {
    const uint64_t query_seed = RoleSeed(context_.seed, "pre-pass");
    B4MRL_ASSIGN_OR_RETURN(
        const ModelData corrections,
        QueryCorrections(context_, dataset_.remote(), *simulator_, query_seed, progress));
    return TrainModel(corrections, progress);
  }
};

Result<std::unique_ptr<Learner>> Create(const LearnerContext& context) {
  B4MRL_ASSIGN_OR_RETURN(ModelBased::Parts parts,
                         ModelBased::Open(context, /*uses_simulator=*/true));
  return std::unique_ptr<Learner>(std::make_unique<Hymopo>(context, std::move(parts)));
}

HyperparameterTable Table() {
  const HyperparameterTable own = {
      PenaltyRow(0, "the paper"),
      Whole("horizon", 5, {1, 1000}, "steps of a rollout in the corrected simulator",
            {.unit = "steps", .source = "the paper, for HalfCheetah; ours elsewhere"}),
      Whole("chunk-rows", 2000, {1, limits::kMaxQueryRows},
            "states and actions in one query to the simulator",
            {.unit = "rows", .source = "ours, by measurement"}),
      WithoutEffect(Whole("chunks-in-flight", 6, {1, limits::kMaxRequestsInFlight},
                          "queries that the daemon is asked at once",
                          {.unit = "queries", .source = "ours, by measurement"})),
  };
  return own + ModelBasedRows();
}

}  // namespace

Algorithm HymopoAlgorithm() {
  return {.name = "hymopo",
          .description =
              "model-based hybrid: a learned correction of the simulator, SAC in the "
              "corrected one",
          .needs = {.simulator = true, .dataset = true, .queries = true},
          .hyperparameters = Table(),
          .create = Create,
          .check = CheckModelBased,
          .threads = 2};
}

}  // namespace b4mrl
