// What an offline learner learns from: random batches of its dataset, corrupted if so asked, which
// stream in ahead of their use; and what a policy trained on them must know of them.
//
// Observations and next observations are (o - mean) / (std + 0.001), mean and std over the
// dataset's observations; actions are in [-1, 1]. Batch b is a function of (run seed, b), so a
// resumed learner only says with which one it goes on. Thread rule: one thread. Errors: those of
// the daemon and its connection.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "algorithms/base/learner.h"
#include "algorithms/cores/transition_batch.h"
#include "algorithms/experience/batch_buffer.h"
#include "algorithms/experience/normaliser.h"
#include "client/remote_dataset.h"

namespace b4mrl {

struct OfflineBatchOptions {
  int batch_size = 256;
  bool normalise = true;  // otherwise observations stay as they are
  // Rewards times 1000 / (largest - smallest return of a complete episode of the dataset).
  bool scale_rewards = false;
  double action_clip = 0;  // actions are clipped to +-(1 - action_clip); 0: they are not clipped
};

// kInvalidArgument for a batch-size that no request holds.
Status CheckOfflineBatches(const LearnerContext& context);

class OfflineBatches {
 public:
  // Opens the context's dataset. kFailedPrecondition when scale_rewards finds no two episodes of
  // different return.
  static Result<OfflineBatches> Open(const LearnerContext& context,
                                     const OfflineBatchOptions& options);

  // Must come before the first Next: the number of the batch that it returns.
  void Start(uint64_t first_batch);
  // Views of one buffer, which the next call overwrites.
  Result<TransitionBatch<float>> Next();

  // Mean and std of its observations and the mask of those that the dataset hid, into `policy`.
  void DescribeInputs(PolicyWeights& policy) const;
  std::string dataset_sha256() const { return dataset_->in_force().info().sha256(); }

  void Save(CheckpointWriter& writer) const;
  // kDataLoss when the checkpoint is of another dataset.
  Status Load(CheckpointReader& reader);

 private:
  OfflineBatches(const LearnerContext& context, const OfflineBatchOptions& options,
                 std::unique_ptr<RemoteDataset> dataset, Normaliser normaliser, float reward_scale);

  uint64_t seed_;
  std::unique_ptr<RemoteDataset> dataset_;  // the stream points at it
  Normaliser normaliser_;
  float reward_scale_;
  float action_max_;
  std::vector<float> mask_;
  std::vector<float> action_scale_;
  BatchBuffer batch_;
  std::optional<BatchStream> stream_;
};

}  // namespace b4mrl
