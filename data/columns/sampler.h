// Chooses the rows of a batch, uniformly with replacement. They are a pure function of (seed, batch
// number, rows of the dataset, batch size), so that a resumed learner needs one integer. Any
// thread.
#pragma once

#include <cstdint>
#include <span>

namespace b4mrl {

// Fills `out` with row numbers in [0, dataset_rows); dataset_rows > 0. Of two batches of the same
// number and different sizes, the longer one begins with the rows of the shorter one.
void SampleRows(uint64_t seed, uint64_t batch, uint64_t dataset_rows, std::span<uint64_t> out);

}  // namespace b4mrl
