// The conversion inside the importer process: one HDF5 file in D4RL's layout to one column cache.
//
// Accepts rewards, terminals and timeouts of shape (N) or (N, 1), float64 columns (rounded to
// float32), boolean or integer flags, missing timeouts (an episode ends at 1,000 steps) and missing
// next_observations (then the rows are those of TransitionRule::kD4rl).
// Errors: kUnknownName (a column is missing), kInvalidArgument (type, rank, unequal lengths, no
// rows), kLimitExceeded (declared size, too large a cache), kDataLoss (truncated, damaged),
// kIoError (full disk).
#pragma once

#include <string>

#include "data/columns/episodes.h"
#include "proto/base/status.h"
#include "server/datasets/importer.h"

namespace b4mrl {

// What identifies a served dataset: 32 hexadecimal characters, the name of its cache folder.
// `corruptions` in their parametric form, "" for none; then the seed does not matter.
std::string DatasetFingerprint(const std::string& sha256, TransitionRule rule,
                               const std::string& corruptions, uint64_t seed);

// Makes the cache and returns its number of rows.
Result<uint64_t> ImportDataset(const ImporterOptions& options);

}  // namespace b4mrl
