// The learner around a core that trains on its own experience: `warm-up` transitions of uniform
// actions, then one gradient step per transition, on a batch drawn from all of them.
//
// Core has Update(batch), whose result its header's AddMetrics takes, Policy(), updates() and the
// visitors of its state: SacCore and Td3Core.
#pragma once

#include <utility>

#include "algorithms/base/learner.h"
#include "algorithms/experience/batch_buffer.h"
#include "algorithms/experience/online_lanes.h"

namespace b4mrl {

template <typename Core>
class OnlineLearner : public Learner {
 public:
  OnlineLearner(const LearnerContext& context, Core core, OnlineLanes lanes)
      : context_(context),
        core_(std::move(core)),
        lanes_(std::move(lanes)),
        batch_(lanes_.observation_size(), context.action_size(), core_.options().batch_max) {}

  Status Prepare(Progress& progress) override {
    B4MRL_RETURN_IF_ERROR(lanes_.Start());
    return lanes_.WarmUp(context_.hyperparameters.Unsigned("warm-up"), progress);
  }

  Status Update(MetricMeans& metrics) override {
    const auto update = static_cast<uint64_t>(core_.updates());
    // A vector step brings as many transitions as there are lanes, and as many updates follow.
    if (update % lanes_.count() == 0) {
      B4MRL_ASSIGN_OR_RETURN(const FixedOrderPolicy policy,
                             FixedOrderPolicy::Create(core_.Policy()));
      B4MRL_RETURN_IF_ERROR(lanes_.Step(policy, metrics));
    }
    Rng rows(RoleSeed(context_.seed, "replay"), "rows", update);
    lanes_.replay().Sample(rows, 0, batch_.size(), batch_);
    AddMetrics(core_.Update(batch_.view()), metrics);
    return Status();
  }

  PolicyWeights Policy() const override {
    PolicyWeights policy = core_.Policy();
    policy.observation_mask = lanes_.policy_mask();
    return policy;
  }

  Status Save(CheckpointWriter& writer) override {
    writer.State("core", core_);
    return lanes_.Save(writer);
  }

  Status Load(CheckpointReader& reader) override {
    reader.StateInto("core", core_);
    return lanes_.Load(reader);
  }

  uint64_t environment_steps() const override { return lanes_.environment_steps(); }

 private:
  const LearnerContext& context_;
  Core core_;
  OnlineLanes lanes_;
  BatchBuffer batch_;
};

}  // namespace b4mrl
