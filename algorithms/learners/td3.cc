// TD3: twin delayed deep deterministic policy gradient, online in a simulator (Fujimoto et al.
// 2018; hyperparameters of the authors' code).
//
//   s, a, r, s'  observation, action in [-1, 1], reward, next observation     d  terminated
//   D            all transitions; batches are drawn from the newest `replay-capacity`
//   pi, Q        deterministic actor and twin critics (cores/td3_core.h has the losses)
//
//   warm up:  D <- `warm-up` transitions of uniform actions
//   repeat:   a = clip(pi(s) + N(0, `exploration-noise`), +-1);  s', r, d <- simulator
//             D <- D + (s, a, r, s', d)                                          in every lane
//             one update per transition: a batch from D, one step of Q; in every
//             `policy-frequency`-th update also a step of pi and of all targets
//
// An episode that ends by the step limit keeps d = 0: its value bootstraps from the final
// observation. experience/replay_collector.h acts and holds D.
#include "algorithms/cores/td3_core.h"

#include <memory>

#include "algorithms/learners/core_options.h"
#include "algorithms/learners/online_learner.h"

namespace b4mrl {
namespace {

constexpr std::string_view kPublished = "sfujim/TD3, which the paper's authors ran";

Result<std::unique_ptr<Learner>> Create(const LearnerContext& context) {
  return CreateOnlineLearner<Td3Core<float>>(context, Td3OptionsOf);
}

HyperparameterTable Table() {
  const HyperparameterTable own = {
      Whole("warm-up", 25'000, {1, 1e9},
            "transitions under uniform actions before the first update",
            {.unit = "transitions", .source = kPublished}),
      Real("exploration-noise", 0.1, {0, 10},
           "standard deviation of the noise on the actions taken in the simulator",
           {.unit = "half the action range", .source = kPublished}),
  };
  return ReplayRows(kPublished) + own + Td3Rows(kPublished);
}

}  // namespace

Algorithm Td3Algorithm() {
  return {.name = "td3",
          .description = "twin delayed deep deterministic policy gradient, online in a simulator",
          .needs = {.simulator = true, .history = true},
          .hyperparameters = Table(),
          .create = Create};
}

}  // namespace b4mrl
