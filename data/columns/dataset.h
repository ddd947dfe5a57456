// A dataset of transitions over a mapped column cache, as the daemon serves it. Immutable; any
// thread. The views stay valid as long as the Dataset lives, even if its folder is removed.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <tuple>

#include "data/columns/column_cache.h"
#include "data/columns/statistics.h"
#include "proto/base/status.h"

namespace b4mrl {

// Views of all columns, or of a block of their rows. The views' sizes agree with each other.
struct TransitionColumns {
  uint64_t rows = 0;
  uint32_t observation_size = 0;
  uint32_t action_size = 0;
  std::span<const float> observations, actions, rewards, next_observations;
  std::span<const uint8_t> terminals, timeouts;

  // Views of the `count` rows from row `first` on; no column may be empty.
  TransitionColumns Rows(uint64_t first, uint64_t count) const;
};

template <typename T>
struct TransitionColumn {
  using Value = T;
  std::string_view name;
  std::span<const T> TransitionColumns::*values;
  uint32_t TransitionColumns::*size;  // elements of a row; null: one, and the column has shape (N)

  size_t width(const TransitionColumns& columns) const { return size ? columns.*size : 1; }
};

// The columns in the order in which caches hold them and replies list them.
inline constexpr std::tuple kTransitionColumns = {
    TransitionColumn<float>{"observations", &TransitionColumns::observations,
                            &TransitionColumns::observation_size},
    TransitionColumn<float>{"actions", &TransitionColumns::actions,
                            &TransitionColumns::action_size},
    TransitionColumn<float>{"rewards", &TransitionColumns::rewards, nullptr},
    TransitionColumn<float>{"next_observations", &TransitionColumns::next_observations,
                            &TransitionColumns::observation_size},
    TransitionColumn<uint8_t>{"terminals", &TransitionColumns::terminals, nullptr},
    TransitionColumn<uint8_t>{"timeouts", &TransitionColumns::timeouts, nullptr},
};

// Calls `visit(column, number)` for the columns of a table in their order, up to the first error,
// which it returns.
template <typename Visit, typename... Columns>
Status VisitColumns(const std::tuple<Columns...>& table, const Visit& visit) {
  Status status;
  size_t number = 0;
  std::apply(
      [&](const Columns&... columns) {
        static_cast<void>(((status = visit(columns, number++)).ok() && ...));
      },
      table);
  return status;
}

class Dataset {
 public:
  // Maps a cache folder and checks sizes; cache().Verify() checks the contents as well.
  static Result<std::shared_ptr<const Dataset>> Open(const std::string& folder);

  const TransitionColumns& columns() const { return columns_; }
  uint64_t rows() const { return columns_.rows; }
  const DatasetStatistics& statistics() const { return statistics_; }
  const ColumnCache& cache() const { return *cache_; }
  // The cache's property `name`; "" if the cache has no property of that name.
  std::string property(std::string_view name) const;

 private:
  Dataset() = default;
  std::shared_ptr<const ColumnCache> cache_;
  TransitionColumns columns_;
  DatasetStatistics statistics_;
};

}  // namespace b4mrl
