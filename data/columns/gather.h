// Copies scattered rows of several columns into contiguous arrays, near the speed of memory.
//
// Rows are visited once, all columns of a row together; the rows some way ahead are prefetched,
// because a batch of random rows of a large dataset misses every cache. Any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>

namespace b4mrl {

struct GatherColumn {
  const std::byte* source = nullptr;  // row-major
  size_t row_bytes = 0;
  std::byte* destination = nullptr;  // rows.size() * row_bytes; does not overlap the source
};

// destination row i = source row rows[i]; the caller has checked that every row exists. Calls
// `alive` every 32 rows.
void GatherRows(
    std::span<const GatherColumn> columns, std::span<const uint64_t> rows,
    const std::function<void()>& alive = [] {});

}  // namespace b4mrl
