// TD3-BC: TD3 with behaviour cloning, offline (Fujimoto and Gu 2021; hyperparameters of the
// authors' code).
//
//   D      dataset of (s, a, r, s', d), as the daemon serves it, with corruptions if asked for
//   pi, Q  deterministic actor and twin critics (cores/td3_core.h, which holds the losses)
//
//   normalise:  s <- (s - mean) / (std + 0.001), mean and std over D's observations
//   repeat:     a batch from D; one step of Q; in every second update, one step of pi that
//               increases  lambda Q_1(s, pi(s)) - (pi(s) - a)^2,  lambda = bc-alpha / mean |Q_1|
//
// The normaliser belongs to the policy and is saved with it (experience/offline_batches.h).
#include <memory>
#include <utility>

#include "algorithms/cores/td3_core.h"
#include "algorithms/learners/core_options.h"
#include "algorithms/learners/offline_learner.h"

namespace b4mrl {
namespace {

constexpr std::string_view kAuthors = "sfujim/TD3_BC, which the paper's authors ran";

Result<std::unique_ptr<Learner>> Create(const LearnerContext& context) {
  const Td3Options options = Td3OptionsOf(context, context.observation_size());
  B4MRL_ASSIGN_OR_RETURN(Td3Core<float> core, Td3Core<float>::Create(options));
  const bool normalise = context.hyperparameters.Chosen("normalise", "true");
  B4MRL_ASSIGN_OR_RETURN(
      OfflineBatches batches,
      OfflineBatches::Open(context, {.batch_size = options.batch_max, .normalise = normalise}));
  return MakeOfflineLearner(std::move(core), std::move(batches));
}

HyperparameterTable Table() {
  const HyperparameterTable own = {
      Real("bc-alpha", 2.5, {0, 1e6},
           "weight of the value against behaviour cloning in the actor's loss",
           {.source = kAuthors}),
      NormaliseRow(kAuthors),
  };
  return own + Td3Rows(kAuthors);
}

}  // namespace

Algorithm Td3BcAlgorithm() {
  return {.name = "td3-bc",
          .description = "TD3 with behaviour cloning, offline on a dataset",
          .needs = {.dataset = true},
          .hyperparameters = Table(),
          .create = Create,
          .check = CheckOfflineBatches};
}

}  // namespace b4mrl
