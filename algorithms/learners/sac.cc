// SAC: soft actor-critic, online in a simulator (Haarnoja et al. 2018).
//
//   s, a, r, s'  observation, action in [-1, 1], reward, next observation     d  terminated
//   D            all transitions; batches are drawn from the newest `replay-capacity`
//   pi, Q        actor and twin critics (rl/sac_core.h has the losses)
//
//   warm up:  D <- `warm-up` transitions of uniform actions
//   repeat:   a ~ pi(s);  s', r, d <- simulator;  D <- D + (s, a, r, s', d)      in every lane
//             one update per transition: a batch from D, one step of the entropy weight, Q and pi
//
// An episode that ends by the step limit keeps d = 0: its value bootstraps from the final
// observation. rl/online_lanes.h acts, rl/online_learner.h is the loop.
#include <memory>
#include <utility>

#include "algorithms/cores/sac_core.h"
#include "algorithms/learners/core_options.h"
#include "algorithms/learners/learners.h"
#include "algorithms/learners/online_learner.h"

namespace b4mrl {
namespace {

constexpr std::string_view kPublished = "Stable-Baselines3, which the paper's authors ran";

constexpr Hyperparameter kHyperparameters[] = {
    {"lanes", 1, 1, 1024, true, "environments stepped at once; as many updates follow",
     "environments", kPublished},
    {"warm-up", 10'000, 1, 1e9, true, "uniform actions before the first update", "transitions",
     "Minari's training of its MuJoCo policies; Stable-Baselines3's own default is 100"},
    {"replay-capacity", 1e6, 1, 1e9, true, "newest that batches are drawn from", "transitions",
     kPublished},
    {"batch-size", 256, 1, 65'536, true, "of one update", "transitions", kPublished},
    {"hidden-width", 256, 1, 2048, true, "of each of the two hidden layers", "units", kPublished},
    {"learning-rate", 3e-4, 1e-8, 1, false, "Adam's, of actor, critics and entropy weight", "",
     kPublished},
    {"gamma", 0.99, 0, 1, false, "discount", "", kPublished},
    {"tau", 0.005, 0, 1, false, "how far the targets follow in one update", "", kPublished},
    {"initial-alpha", 1, 1e-9, 1e3, false, "entropy weight at the start", "", kPublished},
};

}  // namespace

std::span<const Hyperparameter> SacHyperparameters() { return kHyperparameters; }

Result<std::unique_ptr<Learner>> CreateSac(const LearnerContext& context) {
  B4MRL_ASSIGN_OR_RETURN(OnlineLanes lanes, OnlineLanes::Open(context));
  B4MRL_ASSIGN_OR_RETURN(SacCore<float> core,
                         SacCore<float>::Create(SacOptionsOf(context, lanes.observation_size())));
  return std::unique_ptr<Learner>(
      std::make_unique<OnlineLearner<SacCore<float>>>(context, std::move(core), std::move(lanes)));
}

}  // namespace b4mrl
