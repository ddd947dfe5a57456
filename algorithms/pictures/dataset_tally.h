// What the pictures of a dataset show, counted from its rows in two passes: returns of complete
// episodes, and the values of every observation and action dimension.
//
//   for each block: tally.Measure(block);     // ranges
//   tally.PrepareBins(...);
//   for each block: tally.Count(block);       // the same blocks in the same order
//
// Memory is that of the bins, however many rows there are. Thread rule: one thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "algorithms/pictures/histogram.h"

namespace b4mrl {

// Consecutive rows of a dataset, row-major; as many as there are rewards.
struct RowBlock {
  std::span<const float> observations, actions;
  std::span<const float> rewards;
  std::span<const uint8_t> terminals, timeouts;  // non-zero in the last row of an episode
};

class DatasetTally {
 public:
  DatasetTally(size_t observation_size, size_t action_size)
      : observations_(observation_size), actions_(action_size) {}

  void Measure(const RowBlock& block);
  // Between the passes. With `other`, whose first pass is done too, the bins of each observation
  // dimension span the values of both datasets, so that they can be compared.
  void PrepareBins(const DatasetTally* other = nullptr);
  void Count(const RowBlock& block);

  uint64_t rows() const { return rows_; }
  // Whether the rows after the last complete episode begin another one.
  bool has_open_episode() const { return episode_.is_open; }
  const std::vector<NumberRange>& observations() const { return observations_; }
  const std::vector<NumberRange>& actions() const { return actions_; }
  const NumberRange& returns() const { return returns_; }  // undiscounted, of complete episodes
  // After PrepareBins: at most 80 bins of a round width between round edges.
  const std::vector<Histogram>& observation_bins() const { return observation_bins_; }
  const std::vector<Histogram>& action_bins() const { return action_bins_; }
  const Histogram& return_bins() const { return return_bins_; }

 private:
  // The episode of the last row, if that row did not end it.
  struct Episode {
    bool is_open = false;
    double sum = 0;  // of its rewards so far
  };
  template <typename Use>
  void ForEachReturn(const RowBlock& block, const Use& use);

  uint64_t rows_ = 0;
  Episode episode_;
  std::vector<NumberRange> observations_, actions_;
  NumberRange returns_;
  std::vector<Histogram> observation_bins_, action_bins_;
  Histogram return_bins_{0, 1, 1};
};

}  // namespace b4mrl
