// Streams transitions into a column cache that Dataset::Open reads, and computes the statistics on
// the way. Imports use it, and so do derivations of one dataset from another. Thread rule: one
// thread. Errors: as column_cache.h.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "data/columns/column_cache.h"
#include "data/columns/dataset.h"
#include "data/columns/statistics.h"
#include "proto/base/status.h"

namespace b4mrl {

class DatasetBuilder {
 public:
  static Result<DatasetBuilder> Create(const std::string& folder, uint32_t observation_size,
                                       uint32_t action_size);

  // Appends rows, in blocks of any size.
  Status Append(const TransitionColumns& block);
  // Appends the rows of the block that TransitionRule::kD4rl keeps. `all_terminals` and
  // `all_timeouts` are columns of the whole data, in which the block begins at row `first_row`. The
  // block's flags and next_observations are not read. `following_observation` is the observation of
  // the row after the block, or empty at the end of the data.
  Status AppendD4rl(const TransitionColumns& block, uint64_t first_row,
                    std::span<const uint8_t> all_terminals, std::span<const uint8_t> all_timeouts,
                    std::span<const float> following_observation);

  // Gives the dataset the rewards' and returns' statistics of `source` instead of those of the
  // appended rows, because a transition rule drops rows that belong to an episode's return.
  void SetReturns(DatasetStatistics source) { returns_ = std::move(source); }
  void SetProperty(std::string_view name, std::string_view value);
  uint64_t rows() const { return rows_; }
  // Puts the cache into place; kInvalidArgument if no row was appended.
  Status Commit();

 private:
  DatasetBuilder(ColumnCacheWriter cache, uint32_t observation_size, uint32_t action_size);

  ColumnCacheWriter cache_;
  uint32_t observation_size_;
  uint32_t action_size_;
  uint64_t rows_ = 0;
  StatisticsAccumulator statistics_;
  std::optional<DatasetStatistics> returns_;  // set by SetReturns
};

}  // namespace b4mrl
