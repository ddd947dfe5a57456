// Checkpoints and members that bc.cc, td3_bc.cc and iql.cc share: learners that train one core on a
// dataset alone. Core: Td3Core, for instance. Thread rule: one thread.
#pragma once

#include <string>
#include <utility>

#include "algorithms/base/learner.h"
#include "algorithms/experience/offline_batches.h"

namespace b4mrl {

template <typename Core>
class OfflineLearner : public Learner {
 public:
  OfflineLearner(Core core, OfflineBatches batches)
      : core_(std::move(core)), batches_(std::move(batches)) {}

  Status Save(CheckpointWriter& writer) override {
    writer.State("core", core_);
    batches_.Save(writer);
    return Status();
  }
  Status Load(CheckpointReader& reader) override {
    reader.StateInto("core", core_);
    return batches_.Load(reader, static_cast<uint64_t>(core_.updates()));
  }
  bool outlives_daemon() const override { return true; }
  DatasetIdentity dataset_identity() const override { return batches_.dataset_identity(); }

 protected:
  Core core_;
  OfflineBatches batches_;  // batches of D
};

}  // namespace b4mrl
