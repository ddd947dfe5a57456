// TD3 with behaviour cloning, offline (Fujimoto and Gu 2021; hyperparameters of the authors' code).
//
//   D      dataset of (s, a, r, s', d), as the daemon serves it, corrupted if so asked
//   pi, Q  deterministic actor and twin critics (rl/td3_core.h, which holds the losses)
//
//   normalise:  s <- (s - mean) / (std + 0.001), mean and std over D's observations
//   repeat:     a batch from D; one step of Q; every second time one of
//               pi towards  lambda Q_1(s, pi(s)) - (pi(s) - a)^2,  lambda = bc-alpha / mean |Q_1|
//
// The normaliser belongs to the policy and is saved with it (rl/offline_batches.h).
#include <memory>
#include <utility>

#include "algorithms/cores/td3_core.h"
#include "algorithms/learners/core_options.h"
#include "algorithms/learners/learners.h"
#include "algorithms/learners/offline_learner.h"

namespace b4mrl {
namespace {

constexpr std::string_view kAuthors = "sfujim/TD3_BC, which the paper's authors ran";

constexpr Hyperparameter kHyperparameters[] = {
    {"bc-alpha", 2.5, 0, 1e6, false, "weight of the value against cloning", "", kAuthors},
    {"batch-size", 256, 1, 65'536, true, "of one update", "transitions", kAuthors},
    {"hidden-width", 256, 1, 2048, true, "of each of the two hidden layers", "units", kAuthors},
    {"learning-rate", 3e-4, 1e-8, 1, false, "Adam's, of actor and critics", "", kAuthors},
    {"gamma", 0.99, 0, 1, false, "discount", "", kAuthors},
    {"tau", 0.005, 0, 1, false, "how far the targets follow in one update", "", kAuthors},
    {"policy-noise", 0.2, 0, 10, false, "deviation of the target action's noise",
     "half the action range", kAuthors},
    {"noise-clip", 0.5, 0, 10, false, "largest noise of the target action", "half the action range",
     kAuthors},
    {"policy-frequency", 2, 1, 1000, true, "updates of the critics for one of the actor", "updates",
     kAuthors},
    {"normalise", 1, 0, 1, true, "1: normalise observations, 0: do not", "", kAuthors},
};

}  // namespace

std::span<const Hyperparameter> Td3BcHyperparameters() { return kHyperparameters; }

Result<std::unique_ptr<Learner>> CreateTd3Bc(const LearnerContext& context) {
  const Td3Options options = Td3OptionsOf(context, context.observation_size());
  B4MRL_ASSIGN_OR_RETURN(Td3Core<float> core, Td3Core<float>::Create(options));
  B4MRL_ASSIGN_OR_RETURN(
      OfflineBatches batches,
      OfflineBatches::Open(context,
                           {.batch_size = options.batch_max,
                            .normalise = context.hyperparameters.Integer("normalise") == 1}));
  return std::unique_ptr<Learner>(
      std::make_unique<OfflineLearner<Td3Core<float>>>(std::move(core), std::move(batches)));
}

}  // namespace b4mrl
