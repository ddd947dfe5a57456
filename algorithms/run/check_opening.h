// Whether a daemon would open what a run will ask it for. Thread rule: the client's.
#pragma once

#include "algorithms/run/run_record.h"
#include "client/client.h"
#include "proto/base/status.h"

namespace b4mrl {

// Opens, and closes again, the run's simulator, the world of its evaluations and its dataset with
// their perturbations and corruptions, so that a misspelt one is refused before the run has a
// folder, and so is a simulator that cannot answer the queries of the run's algorithm. Nothing is
// counted in a ledger. The daemon's errors, and CheckCorruptionSeed's for a run that is not
// resumed.
Status CheckOpening(const TrainOptions& options, Client& client);

// kInvalidArgument for a --corruption-seed that changes nothing, since no corruption in force draws
// numbers: two seeds would seem to be two draws.
Status CheckCorruptionSeed(uint64_t seed, const RemoteDataset& opened);

}  // namespace b4mrl
