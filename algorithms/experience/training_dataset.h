// Opening the dataset of a run, and making sure that a resumed run meets the same one.
#pragma once

#include <cstdint>
#include <memory>
#include <string_view>
#include <vector>

#include "algorithms/base/checkpoint.h"
#include "algorithms/base/learner.h"
#include "client/remote_dataset.h"
#include "proto/base/status.h"

namespace b4mrl {

// The context's dataset with its corruptions, whose noise is RoleSeed(run seed, "corruption").
// kInvalidArgument when it was recorded in another environment, or its sizes are not the
// environment's. The pointer stays valid: streams need it.
Result<std::unique_ptr<RemoteDataset>> OpenTrainingDataset(const LearnerContext& context);

// Of a batch that is partly the dataset's: real-ratio * batch-size, fractions dropped.
int RealRows(const Hyperparameters& values);
// Whether one request holds the `rows` rows that an update takes from the dataset; kInvalidArgument
// otherwise. `name` says what they are: "batch-size". Needs the context's environment alone.
Status CheckRowsPerUpdate(const LearnerContext& context, std::string_view name, uint64_t rows);

// Observations of `rows` rows, row-major, for rollout number `cycle` to start from: a function of
// (seed, cycle, rows and width of the dataset). Wide rows take several requests, each a batch of
// its own; where one request holds them all, they are those of batch `cycle`.
Result<std::vector<float>> DrawStarts(RemoteDataset& dataset, uint32_t rows, uint64_t seed,
                                      uint64_t cycle);

// kDataLoss unless the checkpoint's "dataset" is this one: a fingerprint covers file, corruptions
// and seed.
Status CheckSameDataset(CheckpointReader& reader, const RemoteDataset& dataset);

}  // namespace b4mrl
