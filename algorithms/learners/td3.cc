// TD3: twin delayed deep deterministic policy gradient, online in a simulator (Fujimoto et al.
// 2018; hyperparameters of the authors' code).
//
//   s, a, r, s'  observation, action in [-1, 1], reward, next observation     d  terminated
//   D            all transitions; batches are drawn from the newest `replay-capacity`
//   pi, Q        deterministic actor and twin critics (rl/td3_core.h has the losses)
//
//   warm up:  D <- `warm-up` transitions of uniform actions
//   repeat:   a = clip(pi(s) + N(0, `exploration-noise`), +-1);  s', r, d <- simulator
//             D <- D + (s, a, r, s', d)                                          in every lane
//             one update per transition: a batch from D, one step of Q; every
//             `policy-frequency`-th time one of pi too, and only then do the targets follow
//
// An episode that ends by the step limit keeps d = 0: its value bootstraps from the final
// observation. rl/online_lanes.h acts, rl/online_learner.h is the loop.
#include <memory>
#include <utility>

#include "algorithms/cores/td3_core.h"
#include "algorithms/learners/core_options.h"
#include "algorithms/learners/learners.h"
#include "algorithms/learners/online_learner.h"

namespace b4mrl {
namespace {

constexpr std::string_view kPublished = "sfujim/TD3, which the paper's authors ran";

constexpr Hyperparameter kHyperparameters[] = {
    {"lanes", 1, 1, 1024, true, "environments stepped at once; as many updates follow",
     "environments", kPublished},
    {"warm-up", 25'000, 1, 1e9, true, "uniform actions before the first update", "transitions",
     kPublished},
    {"exploration-noise", 0.1, 0, 10, false, "deviation of the noise on actions", "", kPublished},
    {"replay-capacity", 1e6, 1, 1e9, true, "newest that batches are drawn from", "transitions",
     kPublished},
    {"batch-size", 256, 1, 65'536, true, "of one update", "transitions", kPublished},
    {"hidden-width", 256, 1, 2048, true, "of each of the two hidden layers", "units", kPublished},
    {"learning-rate", 3e-4, 1e-8, 1, false, "Adam's, of actor and critics", "", kPublished},
    {"gamma", 0.99, 0, 1, false, "discount", "", kPublished},
    {"tau", 0.005, 0, 1, false, "how far the targets follow when they move", "", kPublished},
    {"policy-noise", 0.2, 0, 10, false, "deviation of the noise on target actions", "", kPublished},
    {"noise-clip", 0.5, 0, 10, false, "largest noise on target actions", "", kPublished},
    {"policy-frequency", 2, 1, 1000, true, "updates of the critics for one of the actor", "updates",
     kPublished},
};

}  // namespace

std::span<const Hyperparameter> Td3Hyperparameters() { return kHyperparameters; }

Result<std::unique_ptr<Learner>> CreateTd3(const LearnerContext& context) {
  B4MRL_ASSIGN_OR_RETURN(OnlineLanes lanes, OnlineLanes::Open(context));
  B4MRL_ASSIGN_OR_RETURN(Td3Core<float> core,
                         Td3Core<float>::Create(Td3OptionsOf(context, lanes.observation_size())));
  return std::unique_ptr<Learner>(
      std::make_unique<OnlineLearner<Td3Core<float>>>(context, std::move(core), std::move(lanes)));
}

}  // namespace b4mrl
