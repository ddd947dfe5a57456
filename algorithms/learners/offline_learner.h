// The learner of bc.cc, td3_bc.cc and iql.cc, which trains one core on a dataset alone. Core:
// Td3Core, for instance, with an AddMetrics for what its Update returns. Thread rule: one thread.
#pragma once

#include <memory>
#include <utility>

#include "algorithms/base/learner.h"
#include "algorithms/experience/offline_batches.h"

namespace b4mrl {

template <typename Core>
class OfflineLearner final : public Learner {
 public:
  OfflineLearner(Core core, OfflineBatches batches)
      : core_(std::move(core)), batches_(std::move(batches)) {}

  Status Prepare(Progress&) override {
    batches_.Start(0);
    return Status();
  }
  Status Update(MetricMeans& metrics) override {
    B4MRL_ASSIGN_OR_RETURN(const TransitionBatch<float> batch, batches_.Next());
    AddMetrics(core_.Update(batch), metrics);
    return Status();
  }
  PolicyWeights Policy() const override { return batches_.WithInputs(core_.Policy()); }
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

 private:
  Core core_;
  OfflineBatches batches_;  // batches of D
};

template <typename Core>
std::unique_ptr<Learner> MakeOfflineLearner(Core core, OfflineBatches batches) {
  return std::make_unique<OfflineLearner<Core>>(std::move(core), std::move(batches));
}

}  // namespace b4mrl
