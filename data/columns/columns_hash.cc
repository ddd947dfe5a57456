#include "data/columns/columns_hash.h"

#include <fmt/format.h>

#include <span>

#include "proto/wire/tensor.h"

namespace b4mrl {

void ColumnsHash::Append(const TransitionColumns& block) {
  sizes_.observation_size = block.observation_size;
  sizes_.action_size = block.action_size;
  rows_ += block.rows;
  static_cast<void>(VisitColumns(kTransitionColumns, [&](const auto& column, size_t number) {
    columns_[number].Update(std::as_bytes(block.*column.values));
    return Status();
  }));
}

std::string ColumnsHash::Hex() {
  std::string lines;
  static_cast<void>(VisitColumns(kTransitionColumns, [&](const auto& column, size_t number) {
    using T = typename std::decay_t<decltype(column)>::Value;
    lines += fmt::format("{} {} {} {} {}\n", column.name, DTypeName(DTypeOf<T>()), rows_,
                         column.width(sizes_), columns_[number].Hex());
    return Status();
  }));
  return Sha256OfText(lines);
}

}  // namespace b4mrl
