#include "data/columns/sampler.h"

#include "proto/base/rng.h"

namespace b4mrl {

void SampleRows(uint64_t seed, uint64_t batch, uint64_t dataset_rows, std::span<uint64_t> out) {
  Rng rng(seed, "sample", batch);
  for (uint64_t& row : out) row = rng.Below(dataset_rows);
}

}  // namespace b4mrl
