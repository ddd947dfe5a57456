// The steps of sac.cc and td3.cc, which train one core on their own experience: a transition in
// every lane, then one update for each. Core: SacCore or Td3Core. A learner that does otherwise in
// one of the steps overrides it. Thread rule: one thread.
#pragma once

#include <memory>
#include <utility>

#include "algorithms/base/learner.h"
#include "algorithms/experience/batch_buffer.h"
#include "algorithms/experience/replay_collector.h"

namespace b4mrl {

template <typename Core>
class OnlineLearner : public Learner {
 public:
  OnlineLearner(const LearnerContext& context, Core core, ReplayCollector collector)
      : context_(context),
        core_(std::move(core)),
        collector_(std::move(collector)),
        batch_(collector_.observation_size(), context.action_size(), core_.options().batch_max) {}

  Status Prepare(Progress& progress) override {
    B4MRL_RETURN_IF_ERROR(collector_.Start());
    return collector_.WarmUp(context_.hyperparameters.Unsigned("warm-up"), progress);
  }

  Status Update(MetricMeans& metrics) override {
    const auto update = static_cast<uint64_t>(core_.updates());
    if (update % collector_.lanes() == 0) {
      B4MRL_RETURN_IF_ERROR(collector_.Collect(core_.Policy(), collector_.lanes(), metrics));
    }
    B4MRL_RETURN_IF_ERROR(collector_.KeepSession());  // many lanes, slow updates: steps are rare
    Rng rows(RoleSeed(context_.seed, "replay"), "rows", update);
    collector_.replay().Sample(rows, 0, batch_.size(), batch_);
    AddMetrics(core_.Update(batch_.view()), metrics);
    return Status();
  }

  PolicyWeights Policy() const override { return collector_.WithInputs(core_.Policy()); }

  Status Save(CheckpointWriter& writer) override {
    writer.State("core", core_);
    return collector_.Save(writer);
  }
  Status Load(CheckpointReader& reader) override {
    reader.StateInto("core", core_);
    return collector_.Load(reader);
  }
  uint64_t environment_steps() const override { return collector_.environment_steps(); }

 protected:
  const LearnerContext& context_;
  Core core_;
  ReplayCollector collector_;  // acts, and holds D
  BatchBuffer batch_;
};

// `options_of`: the core's options for a context and the length of an observation.
template <typename Core, typename OptionsOf>
Result<std::unique_ptr<Learner>> CreateOnlineLearner(const LearnerContext& context,
                                                     OptionsOf options_of) {
  B4MRL_ASSIGN_OR_RETURN(ReplayCollector collector, ReplayCollector::Open(context));
  B4MRL_ASSIGN_OR_RETURN(Core core,
                         Core::Create(options_of(context, collector.observation_size())));
  return std::unique_ptr<Learner>(
      std::make_unique<OnlineLearner<Core>>(context, std::move(core), std::move(collector)));
}

}  // namespace b4mrl
