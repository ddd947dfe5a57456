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
#include <utility>

#include "algorithms/learners/core_options.h"
#include "algorithms/learners/online_learner.h"

namespace b4mrl {
namespace {

constexpr std::string_view kPublished = "Stable-Baselines3, which the paper's authors ran";

class Sac final : public OnlineLearner<SacCore<float>> {
 public:
  using OnlineLearner::OnlineLearner;

  Status Prepare(Progress& progress) override {
    B4MRL_RETURN_IF_ERROR(collector_.Start());
    return collector_.WarmUp(context_.hyperparameters.Unsigned("warm-up"), progress);
  }

  Status Update(MetricMeans& metrics) override {
    const uint64_t update = updates();
    if (update % collector_.lanes() == 0) {
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
  const SacOptions options = SacOptionsOf(context, collector.observation_size());
  B4MRL_ASSIGN_OR_RETURN(SacCore<float> core, SacCore<float>::Create(options));
  return std::unique_ptr<Learner>(
      std::make_unique<Sac>(context, std::move(core), std::move(collector)));
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
