// Checkpoints, counters and members that sac.cc and td3.cc share: learners that train one core on
// their own experience. Core: SacCore or Td3Core. Thread rule: one thread.
#pragma once

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
  uint64_t updates() const { return static_cast<uint64_t>(core_.updates()); }

  const LearnerContext& context_;
  Core core_;
  ReplayCollector collector_;  // acts, and holds D
  BatchBuffer batch_;
};

}  // namespace b4mrl
