// The batches that an offline learner trains on: random rows of its dataset, with corruptions if
// asked for, received ahead of their use; and the input statistics for the trained policy.
//
// Observations and next observations are (o - mean) / (std + 0.001), mean and std over the
// dataset's observations; actions are in [-1, 1]. Batch b is a function of (run seed, b), so a
// resumed learner need only name its next batch. Thread rule: one thread. Errors: those of
// the daemon and its connection.
#pragma once

#include <cstdint>
#include <vector>

#include "algorithms/base/learner.h"
#include "algorithms/cores/transition_batch.h"
#include "algorithms/experience/batch_buffer.h"
#include "algorithms/experience/normaliser.h"
#include "algorithms/experience/training_dataset.h"
#include "client/remote_dataset.h"

namespace b4mrl {

struct OfflineBatchOptions {
  int batch_size = 256;
  bool normalise = true;  // whether observations become (o - mean) / (std + 0.001)
  // Whether rewards are multiplied by 1000 / (largest - smallest return of the dataset's complete
  // episodes).
  bool scale_rewards = false;
  double action_clip = 0;  // actions are clipped to +-(1 - action_clip); 0: they are not clipped
};

// kInvalidArgument for a batch-size with more rows than one request to the daemon holds.
Status CheckOfflineBatches(const LearnerContext& context);

class OfflineBatches {
 public:
  // Opens the context's dataset. kFailedPrecondition when scale_rewards finds no two episodes of
  // different return.
  static Result<OfflineBatches> Open(const LearnerContext& context,
                                     const OfflineBatchOptions& options);

  // Must be called before the first Next, with the number of the batch that Next then returns.
  void Start(uint64_t first_batch) { dataset_.Start(first_batch); }
  // The next batch, as views of one buffer that the next call overwrites.
  Result<TransitionBatch<float>> Next();

  // `policy` with the observations' mean and standard deviation and the mask of hidden dimensions.
  PolicyWeights WithInputs(PolicyWeights policy) const;
  DatasetIdentity dataset_identity() const { return dataset_.identity(); }

  void Save(CheckpointWriter& writer) const;
  // Goes on with `next_batch`, as Start does. kDataLoss when the checkpoint is of another dataset.
  Status Load(CheckpointReader& reader, uint64_t next_batch);

 private:
  OfflineBatches(const LearnerContext& context, const OfflineBatchOptions& options,
                 TrainingDataset dataset, Normaliser normaliser, float reward_scale);

  TrainingDataset dataset_;
  Normaliser normaliser_;
  float reward_scale_;
  float action_max_;
  std::vector<float> action_scale_;
  BatchBuffer batch_;
};

}  // namespace b4mrl
