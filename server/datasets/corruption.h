// Corrupted datasets: the perturbations of observations, applied to recorded data.
//
// Row i of the result is a pure function of (noise matrix, corruptions, seed). Observation i gets
// the noise of row i of the dataset's noise matrix, and so does the next observation of row i - 1
// if both rows belong to one episode, or hold one state: a state looks the same in both columns.
// The next observation of an episode's last row i is in no other row, but where D4RL's rule read
// the file; it gets the noise of row i of a second matrix. Noise is drawn once and scaled by its
// level; hidden dimensions are 0 in both columns, as hiding comes last, wherever it is written.
// Every dataset has its own matrix, named by its rows and its environment (identity.h). Rewards,
// actions and flags do not change; infos are never served. Numbers that are not finite pass
// unchanged. Any thread.
#pragma once

#include <atomic>
#include <vector>

#include "data/columns/dataset.h"
#include "data/columns/dataset_builder.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"
#include "server/perturbations/list.h"

namespace b4mrl {

struct Corruption {
  // Its items() are the arguments as the perturbations themselves write them, so that equal
  // corruptions get equal fingerprints.
  PerturbationSet set;
  std::vector<uint32_t> hidden_dimensions;  // sorted
  bool draws = false;                       // whether the noise depends on a seed
};
// Resolves presets and builds the set; refuses perturbations that are unknown or cannot corrupt
// data.
Result<Corruption> MakeCorruption(const std::vector<NamedArgument>& items,
                                  const EnvironmentSpec& spec);

// How the rows of one dataset are corrupted. Refers to the set and the dimensions.
struct RowCorruption {
  const PerturbationSet& set;
  uint64_t seed;
  uint64_t matrix;                        // names the noise matrix (NoiseMatrix)
  std::span<const uint32_t> hidden = {};  // dimensions that the source hides, which stay 0
};
// Appends every row of `source`, corrupted. Ends with Cancelled() within milliseconds after
// `cancelled` turned true.
Status AppendCorrupted(const TransitionColumns& source, const RowCorruption& corruption,
                       const std::atomic<bool>& cancelled, DatasetBuilder* builder);
// kUnavailable, with the text that the work was cancelled.
Status Cancelled();

}  // namespace b4mrl
