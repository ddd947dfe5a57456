#include "data/columns/dataset_builder.h"

#include <utility>

#include "data/columns/episodes.h"

namespace b4mrl {

DatasetBuilder::DatasetBuilder(ColumnCacheWriter cache, uint32_t observation_size,
                               uint32_t action_size)
    : cache_(std::move(cache)),
      observation_size_(observation_size),
      action_size_(action_size),
      statistics_(observation_size) {}

Result<DatasetBuilder> DatasetBuilder::Create(const std::string& folder, uint32_t observation_size,
                                              uint32_t action_size) {
  B4MRL_ASSIGN_OR_RETURN(ColumnCacheWriter cache, ColumnCacheWriter::Create(folder));
  TransitionColumns sizes;
  sizes.observation_size = observation_size;
  sizes.action_size = action_size;
  B4MRL_RETURN_IF_ERROR(VisitColumns(kTransitionColumns, [&](const auto& column, size_t) {
    using T = typename std::decay_t<decltype(column)>::Value;
    return cache.AddColumn(column.name, DTypeOf<T>(), column.width(sizes)).status();
  }));
  return DatasetBuilder(std::move(cache), observation_size, action_size);
}

Status DatasetBuilder::Append(const TransitionColumns& block) {
  // Columns of the cache are numbered in the order in which they were added.
  B4MRL_RETURN_IF_ERROR(VisitColumns(kTransitionColumns, [&](const auto& column, size_t number) {
    return cache_.Append(number, block.*column.values);
  }));
  statistics_.AddObservations(block.observations);
  statistics_.AddRewards(block.rewards, block.terminals, block.timeouts);
  rows_ += block.rows;
  return Status();
}

Status DatasetBuilder::AppendD4rl(const TransitionColumns& block, uint64_t first_row,
                                  std::span<const uint8_t> all_terminals,
                                  std::span<const uint8_t> all_timeouts,
                                  std::span<const float> following_observation) {
  std::vector<float> observations, actions, rewards, next_observations;
  std::vector<uint8_t> terminals, timeouts;
  const auto row_of = [](std::span<const float> all, uint64_t row, uint32_t width) {
    return all.subspan(row * width, width);
  };
  const auto append = [](std::vector<float>* to, std::span<const float> values) {
    to->insert(to->end(), values.begin(), values.end());
  };
  for (uint64_t i = 0; i < block.rows; ++i) {
    const uint64_t row = first_row + i;
    if (!D4rlKeeps(all_timeouts, row)) continue;
    append(&observations, row_of(block.observations, i, observation_size_));
    append(&actions, row_of(block.actions, i, action_size_));
    append(&rewards, row_of(block.rewards, i, 1));
    append(&next_observations, i + 1 < block.rows
                                   ? row_of(block.observations, i + 1, observation_size_)
                                   : following_observation);
    terminals.push_back(all_terminals[row]);
    timeouts.push_back(D4rlTimeout(all_terminals, all_timeouts, row) ? 1 : 0);
  }
  return Append({rewards.size(), observation_size_, action_size_, observations, actions, rewards,
                 next_observations, terminals, timeouts});
}

void DatasetBuilder::SetProperty(std::string_view name, std::string_view value) {
  cache_.SetProperty(name, value);
}

Status DatasetBuilder::Commit() {
  if (rows_ == 0) return Status(StatusCode::kInvalidArgument, "the dataset has no transitions");
  DatasetStatistics statistics = statistics_.Finish();
  if (returns_) {
    returns_->observation_mean = std::move(statistics.observation_mean);
    returns_->observation_std = std::move(statistics.observation_std);
    statistics = std::move(*returns_);
  }
  StoreStatistics(statistics, &cache_);
  return cache_.Commit();
}

}  // namespace b4mrl
