// Converts one HDF5 file in D4RL's layout to one column cache, inside the importer's process
// (server/datasets/importer.h).
//
// Accepts rewards, terminals and timeouts of shape (N) or (N, 1), float64 columns (rounded to
// float32), boolean or integer flags, missing timeouts (an episode ends at 1,000 steps) and missing
// next_observations (then the rows are those of TransitionRule::kD4rl; so are those of a file whose
// metadata/transitions says "d4rl").
// Errors: kUnknownName (a column is missing), kInvalidArgument (wrong type or rank, unequal
// lengths, no rows), kLimitExceeded (declared size or cache too large), kDataLoss (file truncated
// or damaged), kIoError (full disk).
#pragma once

#include <cstdint>
#include <string>

#include "data/d4rl/dataset_provenance.h"
#include "proto/base/status.h"

namespace b4mrl {

struct ImportedDataset {
  uint64_t rows = 0;
  std::string behaviour_policy;  // in words; "" if the file does not name it
  DatasetProvenance provenance;
  // Whether the file has no timeouts, so that its episodes were cut at kD4rlStepLimit steps.
  bool infers_timeouts = false;
};

// Makes the column cache `cache_folder` from the HDF5 file `file_path`. The cache's properties are
// the transition rule and the statistics; what else the file says is returned, so that files with
// equal rows give equal caches. kLimitExceeded if the cache would take more than `max_cache_bytes`.
Result<ImportedDataset> ImportDataset(const std::string& file_path, const std::string& cache_folder,
                                      uint64_t max_cache_bytes);

}  // namespace b4mrl
