#include "data/columns/dataset.h"

#include <fmt/format.h>

namespace b4mrl {

TransitionColumns TransitionColumns::Rows(uint64_t first, uint64_t count) const {
  TransitionColumns part = *this;
  part.rows = count;
  static_cast<void>(VisitColumns(kTransitionColumns, [&](const auto& column, size_t) {
    const size_t width = column.width(*this);
    part.*column.values = (this->*column.values).subspan(first * width, count * width);
    return Status();
  }));
  return part;
}

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
  columns.rows = observations->rows;
  columns.observation_size = static_cast<uint32_t>(observations->width);
  columns.action_size = static_cast<uint32_t>(actions->width);
  if (columns.rows == 0 || columns.observation_size == 0 || columns.action_size == 0) {
    return Status(StatusCode::kDataLoss, fmt::format("column cache {} has no rows", folder));
  }
  B4MRL_RETURN_IF_ERROR(VisitColumns(kTransitionColumns, [&](const auto& column, size_t) -> Status {
    using T = typename std::decay_t<decltype(column)>::Value;
    B4MRL_ASSIGN_OR_RETURN(columns.*column.values,
                           cache.Find<T>(column.name, columns.rows, column.width(columns)));
    return Status();
  }));
  B4MRL_ASSIGN_OR_RETURN(dataset->statistics_, LoadStatistics(cache.properties()));
  if (dataset->statistics_.observation_mean.size() != columns.observation_size) {
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
