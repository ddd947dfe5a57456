// SAC: soft actor-critic, online in a simulator (Haarnoja et al. 2018).
//
//   s, a, r, s'  observation, action in [-1, 1], reward, next observation     d  terminated
//   D            all transitions; batches are drawn from the newest `replay-capacity`
//   pi, Q        actor and twin critics (cores/sac_core.h has the losses)
//
//   warm up:  D <- `warm-up` transitions of uniform actions
//   repeat:   a ~ pi(s);  s', r, d <- simulator;  D <- D + (s, a, r, s', d)      in every lane
//             one update per transition: a batch from D, one step of the entropy weight, Q and pi
//
// An episode that ends by the step limit keeps d = 0: its value bootstraps from the final
// observation. experience/replay_collector.h acts and holds D.
#include "algorithms/cores/sac_core.h"

#include <memory>

#include "algorithms/learners/core_options.h"
#include "algorithms/learners/online_learner.h"

namespace b4mrl {
namespace {

constexpr std::string_view kPublished = "Stable-Baselines3, which the paper's authors ran";

Result<std::unique_ptr<Learner>> Create(const LearnerContext& context) {
  return CreateOnlineLearner<SacCore<float>>(context, SacOptionsOf);
}

HyperparameterTable Table() {
  const HyperparameterTable own = {
      Whole("warm-up", 10'000, {1, 1e9},
            "transitions under uniform actions before the first update",
            {.unit = "transitions",
             .source = "Minari's training of its MuJoCo policies; Stable-Baselines3's own "
                       "default is 100"}),
      InitialAlphaRow(kPublished),
  };
  return ReplayRows(kPublished) + own + ActorCriticRows(kPublished);
}

}  // namespace

Algorithm SacAlgorithm() {
  return {.name = "sac",
          .description = "soft actor-critic, online in a simulator",
          .needs = {.simulator = true, .history = true},
          .hyperparameters = Table(),
          .create = Create};
}

}  // namespace b4mrl
