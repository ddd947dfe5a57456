// Chooses the rows of a batch, uniformly with replacement. The rows are a pure function of (seed,
// batch number, rows of the dataset, batch size), so a resumed learner needs only the number of its
// next batch. Any thread.
#pragma once

#include <cstdint>
#include <span>

namespace b4mrl {

// Fills `out` with row numbers in [0, dataset_rows); dataset_rows > 0. If two batches differ only
// in their size, the longer batch begins with the rows of the shorter batch.
void SampleRows(uint64_t seed, uint64_t batch, uint64_t dataset_rows, std::span<uint64_t> out);

}  // namespace b4mrl
