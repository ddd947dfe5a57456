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
#include <utility>

#include "algorithms/learners/core_options.h"
#include "algorithms/learners/online_learner.h"

namespace b4mrl {
namespace {

constexpr std::string_view kPublished = "sfujim/TD3, which the paper's authors ran";

class Td3 final : public OnlineLearner<Td3Core<float>> {
 public:
  using OnlineLearner::OnlineLearner;

  Status Prepare(Progress& progress) override {
    B4MRL_RETURN_IF_ERROR(collector_.Start());
    return collector_.WarmUp(context_.hyperparameters.Unsigned("warm-up"), progress);
  }

  Status Update(MetricMeans& metrics) override {
    const uint64_t update = updates();
    if (update % collector_.lanes() == 0) {  // adds `exploration-noise`
      B4MRL_RETURN_IF_ERROR(collector_.Collect(core_.Policy(), collector_.lanes(), metrics));
    }
    Rng rows(RoleSeed(context_.seed, "replay"), "rows", update);
    collector_.replay().Sample(rows, 0, batch_.size(), batch_);
    AddMetrics(core_.Update(batch_.view()), metrics);
    return Status();
  }

  PolicyWeights Policy() const override { return collector_.WithInputs(core_.Policy()); }
};

Result<std::unique_ptr<Learner>> Create(const LearnerContext& context) {
  B4MRL_ASSIGN_OR_RETURN(ReplayCollector collector, ReplayCollector::Open(context));
  const Td3Options options = Td3OptionsOf(context, collector.observation_size());
  B4MRL_ASSIGN_OR_RETURN(Td3Core<float> core, Td3Core<float>::Create(options));
  return std::unique_ptr<Learner>(
      std::make_unique<Td3>(context, std::move(core), std::move(collector)));
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
