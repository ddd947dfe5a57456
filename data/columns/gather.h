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
// Calls `pace` after the first row, and then after as many rows as it returned; ends when that is
// 0. Returns how many rows it has copied.
size_t GatherRows(
    std::span<const GatherColumn> columns, std::span<const uint64_t> rows,
    const std::function<size_t()>& pace = [] { return SIZE_MAX; });

}  // namespace b4mrl
