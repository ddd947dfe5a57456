// How many rows of a dataset are worked on at once. Any thread.
#pragma once

#include <algorithm>
#include <cstdint>

#include "data/columns/dataset.h"

namespace b4mrl {

// Bytes of the rows that are copied at once; three derivations run side by side.
inline constexpr uint64_t kRowBlockBytes = 8ull << 20;

inline uint64_t BytesOfRow(const TransitionColumns& columns) {
  uint64_t bytes = 0;
  static_cast<void>(VisitColumns(kTransitionColumns, [&](const auto& column, size_t) {
    bytes += column.width(columns) * sizeof(typename std::decay_t<decltype(column)>::Value);
    return Status();
  }));
  return bytes;
}

// As many rows as have kRowBlockBytes together, at least one and at most `most`.
inline uint64_t RowsAtOnce(const TransitionColumns& columns, uint64_t most) {
  return std::clamp<uint64_t>(kRowBlockBytes / BytesOfRow(columns), 1, most);
}

}  // namespace b4mrl
