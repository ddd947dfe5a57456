// Converts one HDF5 file in D4RL's layout to one column cache, inside the importer's process
// (server/datasets/importer.h).
//
// Accepts rewards, terminals and timeouts of shape (N) or (N, 1), float64 columns (rounded to
// float32), boolean or integer flags, missing timeouts (an episode ends at 1,000 steps) and missing
// next_observations (then the rows are those of TransitionRule::kD4rl).
// Errors: kUnknownName (a column is missing), kInvalidArgument (wrong type or rank, unequal
// lengths, no rows), kLimitExceeded (declared size or cache too large), kDataLoss (file truncated
// or damaged), kIoError (full disk).
#pragma once

#include <cstdint>
#include <string>

#include "data/columns/episodes.h"
#include "proto/base/status.h"

namespace b4mrl {

// The fingerprint that identifies a served dataset and names its cache folder: 32 hexadecimal
// digits. `corruptions` are in their parametric form, "" for none; without corruptions the seed
// does not matter.
std::string DatasetFingerprint(const std::string& sha256, TransitionRule rule,
                               const std::string& corruptions, uint64_t seed);

// Makes the column cache `cache_folder` from the HDF5 file `file_path` and returns the number of
// rows. kLimitExceeded if the cache would take more than `max_cache_bytes`.
Result<uint64_t> ImportDataset(const std::string& file_path, const std::string& cache_folder,
                               uint64_t max_cache_bytes);

}  // namespace b4mrl
