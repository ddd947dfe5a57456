// The dataset of a run: opened with its corruptions, received ahead as random rows for each update,
// and checked by a resumed run to be the same dataset.
//
// The rows of update u are a function of (run seed, u), so a resumed learner need only name its
// next update. Thread rule: one thread. Errors: those of the daemon and its connection, and
// kDataLoss for numbers that are not finite: learners would diverge and not say why.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

#include "algorithms/base/checkpoint.h"
#include "algorithms/base/learner.h"
#include "client/remote_dataset.h"
#include "proto/base/status.h"

namespace b4mrl {

// Opens the context's dataset with its corruptions, whose noise does not depend on the run's seed.
// kInvalidArgument when the dataset was recorded in another environment, or its sizes are not the
// environment's; kDataLoss, naming the dimension, when an observation or reward is not finite, as
// far as the dataset's statistics tell. A pointer, since streams need the dataset to stay where it
// is.
Result<std::unique_ptr<RemoteDataset>> OpenTrainingDataset(const LearnerContext& context);

// kDataLoss, naming dimension and row, for the first number of the rows that is not finite, which
// the dataset has from `first_row` on or, where they have them, at their indices.
Status CheckFiniteRows(const RemoteDataset& dataset, const TransitionRows& rows,
                       uint64_t first_row = 0);

class TrainingDataset {
 public:
  // `rows`: how many rows each update takes from the dataset; may be 0.
  static Result<TrainingDataset> Open(const LearnerContext& context, int rows);

  // Must be called before the first Next, with the number of the update whose rows Next returns.
  void Start(uint64_t update);
  // The next update's rows, valid until the next call; empty where an update takes none. kDataLoss,
  // naming the row, if an action, reward or next observation among them is not finite.
  Result<TransitionRows> Next();

  void Save(CheckpointWriter& writer) const { writer.Text("dataset", remote_->fingerprint()); }
  // Goes on with `update`, as Start does. kDataLoss when the checkpoint is of another file, other
  // corruptions or another seed.
  Status Load(CheckpointReader& reader, uint64_t update);

  RemoteDataset& remote() const { return *remote_; }
  // For each dimension of an observation 1, or 0 where corruptions hide it or where the behaviour
  // policy could not see it; empty: none is hidden.
  const std::vector<float>& mask() const { return mask_; }
  DatasetIdentity identity() const {
    const pb::DatasetInfo& info = remote_->in_force().info();
    return {info.name(), info.sha256(), info.columns_sha256(),
            remote_->in_force().transition_rule()};
  }

 private:
  TrainingDataset(std::unique_ptr<RemoteDataset> remote, int rows, uint64_t seed,
                  std::vector<float> mask);

  std::unique_ptr<RemoteDataset> remote_;  // stream_ points at the dataset
  int rows_;
  uint64_t seed_;
  std::vector<float> mask_;
  std::optional<BatchStream> stream_;
};

// Rows of a batch that come from the dataset: real-ratio * batch-size, fractions dropped.
int RealRows(const Hyperparameters& values);
// Whether one request holds the `rows` rows that an update takes from the dataset; kInvalidArgument
// otherwise, naming `name` ("batch-size"). Needs the context's environment alone.
Status CheckRowsPerUpdate(const LearnerContext& context, std::string_view name, uint64_t rows);

// Observations of `rows` rows, row-major, for rollout number `cycle` to start from: a function of
// (seed, cycle, number and width of the rows). Wide rows take several requests, each a batch of its
// own; where one request holds all rows, they are those of batch `cycle`.
Result<std::vector<float>> DrawStarts(RemoteDataset& dataset, uint32_t rows, uint64_t seed,
                                      uint64_t cycle);

}  // namespace b4mrl
