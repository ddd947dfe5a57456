// Statistics of a dataset: moments of its observations, returns of its episodes. They are computed
// once, while the rows stream into a cache, and stored with the cache. One thread at a time;
// results are values.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "data/columns/column_cache.h"
#include "proto/base/status.h"

namespace b4mrl {

struct DatasetStatistics {
  // Mean and population standard deviation of each observation dimension, over the column
  // `observations`. NaN for a dimension whose data holds a NaN.
  std::vector<double> observation_mean, observation_std;
  uint64_t episodes = 0;  // number of episodes, including a last episode that is not complete
  // Statistics of the undiscounted returns of complete episodes, with the population standard
  // deviation. NaN if there is no complete episode.
  double mean_return = 0, std_return = 0, min_return = 0, max_return = 0;
  double min_reward = 0, max_reward = 0;  // NaN without rows
};

// Mean, standard deviation and range of a stream of numbers, by Welford's method: one pass in
// order, so equal streams give equal bits. A NaN among the numbers makes all results NaN.
class Moments {
 public:
  void Add(double value);
  uint64_t count() const { return count_; }
  double mean() const;
  double std() const;  // population standard deviation
  double min() const;
  double max() const;

 private:
  uint64_t count_ = 0;
  double mean_ = 0, squares_ = 0, min_ = 0, max_ = 0;
};

// Accumulates statistics over rows that are added in order, in blocks of any size.
class StatisticsAccumulator {
 public:
  explicit StatisticsAccumulator(uint32_t observation_size) : observations_(observation_size) {}
  void AddObservations(std::span<const float> observations);
  void AddRewards(std::span<const float> rewards, std::span<const uint8_t> terminals,
                  std::span<const uint8_t> timeouts);
  DatasetStatistics Finish() const;

 private:
  std::vector<Moments> observations_;
  Moments rewards_, returns_;
  double open_return_ = 0;
  bool episode_open_ = false;
  uint64_t episodes_ = 0;
};

// Writes statistics into a cache's properties, and reads them back without loss.
void StoreStatistics(const DatasetStatistics& statistics, ColumnCacheWriter* cache);
Result<DatasetStatistics> LoadStatistics(const CacheProperties& properties);

}  // namespace b4mrl
