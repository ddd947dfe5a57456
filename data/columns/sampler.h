// Which rows a batch holds: a pure function of (seed, batch number, rows of the dataset, batch
// size), so that a resumed learner needs one integer. Uniform with replacement. Any thread.
#pragma once

#include <cstdint>
#include <span>

namespace b4mrl {

// Fills `out` with row numbers in [0, dataset_rows); dataset_rows > 0. A longer batch of the same
// number starts with the shorter one's rows.
void SampleRows(uint64_t seed, uint64_t batch, uint64_t dataset_rows, std::span<uint64_t> out);

}  // namespace b4mrl
