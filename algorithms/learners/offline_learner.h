// The learner around a core that trains on a dataset alone: update b is one gradient step on the
// dataset's batch b.
//
// Core has Update(batch), whose result its header's AddMetrics takes, Policy(), updates() and the
// visitors of its state: Td3Core and IqlCore.
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

  Status Prepare(Progress&) override {
    batches_.Start(0);
    return Status();
  }

  Status Update(MetricMeans& metrics) override {
    B4MRL_ASSIGN_OR_RETURN(const TransitionBatch<float> batch, batches_.Next());
    AddMetrics(core_.Update(batch), metrics);
    return Status();
  }

  PolicyWeights Policy() const override {
    PolicyWeights policy = core_.Policy();
    batches_.DescribeInputs(policy);
    return policy;
  }

  Status Save(CheckpointWriter& writer) override {
    writer.State("core", core_);
    batches_.Save(writer);
    return Status();
  }

  Status Load(CheckpointReader& reader) override {
    reader.StateInto("core", core_);
    B4MRL_RETURN_IF_ERROR(batches_.Load(reader));
    batches_.Start(static_cast<uint64_t>(core_.updates()));
    return Status();
  }

  bool outlives_daemon() const override { return true; }
  std::string dataset_sha256() const override { return batches_.dataset_sha256(); }

 private:
  Core core_;
  OfflineBatches batches_;
};

}  // namespace b4mrl
