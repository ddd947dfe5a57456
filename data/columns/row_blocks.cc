#include "data/columns/row_blocks.h"

#include <algorithm>
#include <type_traits>

#include "data/columns/columns_hash.h"

namespace b4mrl {
namespace {

constexpr uint64_t kMaxRowsAtOnce = 65'536;  // between two looks at whether to go on

}  // namespace

uint64_t BytesOfRow(const TransitionColumns& columns) {
  uint64_t bytes = 0;
  static_cast<void>(VisitColumns(kTransitionColumns, [&](const auto& column, size_t) {
    bytes += column.width(columns) * sizeof(typename std::decay_t<decltype(column)>::Value);
    return Status();
  }));
  return bytes;
}

uint64_t RowsAtOnce(const TransitionColumns& columns, uint64_t most) {
  return std::clamp<uint64_t>(kRowBlockBytes / BytesOfRow(columns), 1, most);
}

Status AppendUnderD4rl(const TransitionColumns& all, const std::function<Status()>& go_on,
                       DatasetBuilder* builder) {
  const uint64_t step = RowsAtOnce(all, kMaxRowsAtOnce);
  for (uint64_t first = 0; first < all.rows; first += step) {
    B4MRL_RETURN_IF_ERROR(go_on());
    const TransitionColumns block = all.Rows(first, std::min(step, all.rows - first));
    const uint64_t end = first + block.rows;
    const TransitionColumns following = all.Rows(end, std::min<uint64_t>(1, all.rows - end));
    B4MRL_RETURN_IF_ERROR(
        builder->AppendD4rl(block, first, all.terminals, all.timeouts, following.observations));
  }
  return Status();
}

Result<std::string> HashOfRows(const TransitionColumns& all, const std::function<Status()>& go_on) {
  ColumnsHash hash;
  const uint64_t step = RowsAtOnce(all, kMaxRowsAtOnce);
  for (uint64_t first = 0; first < all.rows; first += step) {
    B4MRL_RETURN_IF_ERROR(go_on());
    hash.Append(all.Rows(first, std::min(step, all.rows - first)));
  }
  return hash.Hex();
}

}  // namespace b4mrl
