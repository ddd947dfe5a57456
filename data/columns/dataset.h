// A dataset of transitions over a mapped column cache: what the daemon serves.
//
//   observations (N, obs) f32   actions (N, act) f32   next_observations (N, obs) f32
//   rewards (N) f32             terminals (N) u8       timeouts (N) u8
//
// Immutable; any thread. The views live as long as the Dataset, also when its folder is removed.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "data/columns/column_cache.h"
#include "data/columns/statistics.h"
#include "proto/base/status.h"

namespace b4mrl {

// Views of all columns, or of a block of rows; sizes agree with each other.
struct TransitionColumns {
  uint64_t rows = 0;
  uint32_t observation_size = 0;
  uint32_t action_size = 0;
  std::span<const float> observations, actions, rewards, next_observations;
  std::span<const uint8_t> terminals, timeouts;
};

class Dataset {
 public:
  // Maps a cache folder. Sizes are checked; call cache().Verify() where contents must be too.
  static Result<std::shared_ptr<const Dataset>> Open(const std::string& folder);

  const TransitionColumns& columns() const { return columns_; }
  uint64_t rows() const { return columns_.rows; }
  const DatasetStatistics& statistics() const { return statistics_; }
  const ColumnCache& cache() const { return *cache_; }
  // "" when the cache has no such property.
  std::string property(std::string_view name) const;

 private:
  Dataset() = default;
  std::shared_ptr<const ColumnCache> cache_;
  TransitionColumns columns_;
  DatasetStatistics statistics_;
};

}  // namespace b4mrl
