#include "data/columns/dataset.h"

#include <fmt/format.h>

namespace b4mrl {

Result<std::shared_ptr<const Dataset>> Dataset::Open(const std::string& folder) {
  std::shared_ptr<Dataset> dataset(new Dataset());
  B4MRL_ASSIGN_OR_RETURN(dataset->cache_, ColumnCache::Map(folder));
  const ColumnCache& cache = *dataset->cache_;
  const CachedColumn* observations = cache.Describe("observations");
  const CachedColumn* actions = cache.Describe("actions");
  if (observations == nullptr || actions == nullptr) {
    return Status(StatusCode::kDataLoss,
                  fmt::format("column cache {} lacks observations or actions", folder));
  }
  TransitionColumns& columns = dataset->columns_;
  const uint64_t rows = columns.rows = observations->rows;
  columns.observation_size = static_cast<uint32_t>(observations->width);
  columns.action_size = static_cast<uint32_t>(actions->width);
  const uint32_t size = columns.observation_size;
  B4MRL_ASSIGN_OR_RETURN(columns.observations, cache.Find<float>("observations", rows, size));
  B4MRL_ASSIGN_OR_RETURN(columns.next_observations,
                         cache.Find<float>("next_observations", rows, size));
  B4MRL_ASSIGN_OR_RETURN(columns.actions, cache.Find<float>("actions", rows, columns.action_size));
  B4MRL_ASSIGN_OR_RETURN(columns.rewards, cache.Find<float>("rewards", rows, 1));
  B4MRL_ASSIGN_OR_RETURN(columns.terminals, cache.Find<uint8_t>("terminals", rows, 1));
  B4MRL_ASSIGN_OR_RETURN(columns.timeouts, cache.Find<uint8_t>("timeouts", rows, 1));
  B4MRL_ASSIGN_OR_RETURN(dataset->statistics_, LoadStatistics(cache.properties()));
  if (dataset->statistics_.observation_mean.size() != size) {
    return Status(StatusCode::kDataLoss,
                  fmt::format("column cache {} has statistics of other dimensions", folder));
  }
  return std::shared_ptr<const Dataset>(std::move(dataset));
}

std::string Dataset::property(std::string_view name) const {
  const auto found = cache_->properties().find(name);
  return found == cache_->properties().end() ? "" : found->second;
}

}  // namespace b4mrl
