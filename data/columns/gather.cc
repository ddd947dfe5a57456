#include "data/columns/gather.h"

#include <algorithm>
#include <cstring>

namespace b4mrl {
namespace {

constexpr size_t kCacheLine = 64;
// Rows that are prefetched ahead: enough to hide the latency of memory, and few enough for the
// processor's miss buffers.
constexpr size_t kRowsAhead = 12;

void PrefetchRow(const GatherColumn& column, uint64_t row) {
  const std::byte* begin = column.source + row * column.row_bytes;
  for (size_t offset = 0; offset < column.row_bytes; offset += kCacheLine) {
    __builtin_prefetch(begin + offset);
  }
  __builtin_prefetch(begin + column.row_bytes - 1);
}

// Copies a row. Rows are short, so copies of pieces of fixed size, the last of which overlaps the
// one before it, are faster than a call of memcpy.
inline void CopyRow(std::byte* to, const std::byte* from, size_t bytes) {
  constexpr size_t kPiece = 16;
  if (bytes >= kPiece) {
    for (size_t offset = 0; offset + kPiece < bytes; offset += kPiece) {
      std::memcpy(to + offset, from + offset, kPiece);
    }
    std::memcpy(to + bytes - kPiece, from + bytes - kPiece, kPiece);
  } else if (bytes == 4) {
    std::memcpy(to, from, 4);
  } else if (bytes == 1) {
    *to = *from;
  } else {
    std::memcpy(to, from, bytes);
  }
}

}  // namespace

size_t GatherRows(std::span<const GatherColumn> columns, std::span<const uint64_t> rows,
                  const std::function<size_t()>& pace) {
  const size_t count = rows.size();
  for (size_t i = 0; i < std::min(count, kRowsAhead); ++i) {
    for (const GatherColumn& column : columns) PrefetchRow(column, rows[i]);
  }
  size_t stop = 1;
  for (size_t i = 0; i < count; ++i) {
    if (i == stop) {
      const size_t more = pace();
      if (more == 0) return i;
      stop = i + std::min(more, count - i);
    }
    if (i + kRowsAhead < count) {
      for (const GatherColumn& column : columns) PrefetchRow(column, rows[i + kRowsAhead]);
    }
    for (const GatherColumn& column : columns) {
      CopyRow(column.destination + i * column.row_bytes, column.source + rows[i] * column.row_bytes,
              column.row_bytes);
    }
  }
  return count;
}

}  // namespace b4mrl
