// Copies scattered rows of several columns into contiguous arrays, near the speed of memory.
//
// Rows are visited once, all columns of a row together. Later rows are prefetched, because random
// rows of a large dataset are in no cache of the processor. Any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>

namespace b4mrl {

struct GatherColumn {
  const std::byte* source = nullptr;  // row-major
  size_t row_bytes = 0;
  std::byte* destination = nullptr;  // rows.size() * row_bytes bytes; must not overlap the source
};

// Copies source row rows[i] to destination row i; the caller has checked that every row exists.
// Calls `goes_on` every 32 rows and ends when it returns false. Returns how many rows it has
// copied.
size_t GatherRows(
    std::span<const GatherColumn> columns, std::span<const uint64_t> rows,
    const std::function<bool()>& goes_on = [] { return true; });

}  // namespace b4mrl
