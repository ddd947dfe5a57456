// MOPO: model-based offline policy optimisation (Yu et al. 2020), as the B4MRL paper's authors ran
// it (junming-yang/mopo), but for its SAC update, which is that of the learner sac, in another
// order and with half the critics' loss (cores/sac_core.h). The options' help says where MOPO's
// official code differs.
//
//   D        dataset of (o, a, r, o', d)       D_model  transitions of recent rollouts in the model
//   f        ensemble of Gaussian networks (o, a) -> (delta, r)         (model/dynamics_ensemble.h)
//   pi       SAC's policy                                                       (cores/sac_core.h)
//
//   train f on targets [o' - o, r] by likelihood                     (model/ensemble_store.h)
//   repeat:  every `rollout-every` updates: `rollout-rows` starts from D, `horizon` steps of
//              a ~ pi(o);  (delta, r) ~ f_i(o, a), i a random elite;  o' = o + delta;
//              r~ = r - `penalty` * max_i |std_i(o, a)|, until the termination function says that
//              o' ends the episode; add (o, a, r~, o', d) to D_model    (model/model_rollout.h)
//            one SAC update on a batch, `real-ratio` of it from D, the rest from D_model
//
// learners/model_based.h has the steps, which HyMOPO shares.
#include <memory>
#include <utility>

#include "algorithms/learners/model_based.h"
#include "algorithms/learners/model_based_options.h"
#include "algorithms/model/termination.h"

namespace b4mrl {
namespace {

constexpr std::string_view kPenaltySource =
    "junming-yang/mopo, where it is fixed; official, by dataset: 0.5 to 5 (HalfCheetah/medium 1)";
constexpr std::string_view kHorizonSource =
    "junming-yang/mopo; official, by dataset: 1 or 5 (HalfCheetah/medium 1)";
constexpr EnvironmentDefault kHorizons[] = {{"Walker2d", 1}};

class Mopo final : public ModelBased {
 public:
  using ModelBased::ModelBased;

  Status Prepare(Progress& progress) override {
    B4MRL_ASSIGN_OR_RETURN(const ModelData changes,
                           ReadChanges(context_, dataset_.remote(), progress));
    return TrainModel(changes, progress);
  }
};

Result<std::unique_ptr<Learner>> Create(const LearnerContext& context) {
  B4MRL_ASSIGN_OR_RETURN(ModelBased::Parts parts,
                         ModelBased::Open(context, /*uses_simulator=*/false));
  return std::unique_ptr<Learner>(std::make_unique<Mopo>(context, std::move(parts)));
}

Status Check(const LearnerContext& context) {
  B4MRL_RETURN_IF_ERROR(CheckModelBased(context));
  return Termination::Of(context.environment).status();
}

HyperparameterTable Table() {
  const HyperparameterTable own = {
      PenaltyRow(1, kPenaltySource),
      Whole("horizon", 5, {1, 1000}, "steps of a rollout in the model",
            {.unit = "steps", .source = kHorizonSource, .by_environment = kHorizons}),
  };
  return own + ModelBasedRows();
}

}  // namespace

Algorithm MopoAlgorithm() {
  return {.name = "mopo",
          .description =
              "model-based, offline on a dataset: SAC on short rollouts in a learned "
              "model",
          .needs = {.dataset = true},
          .hyperparameters = Table(),
          .create = Create,
          .check = Check,
          .threads = 2};
}

}  // namespace b4mrl
