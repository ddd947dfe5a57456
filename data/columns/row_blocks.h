// Work on the rows of a dataset in blocks, as wide rows take much memory. Any thread.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "data/columns/dataset.h"
#include "data/columns/dataset_builder.h"
#include "proto/base/status.h"

namespace b4mrl {

// Bytes of the rows that are copied at once; three derivations run side by side.
inline constexpr uint64_t kRowBlockBytes = 8ull << 20;

uint64_t BytesOfRow(const TransitionColumns& columns);
// As many rows as have kRowBlockBytes together, at least one and at most `most`.
uint64_t RowsAtOnce(const TransitionColumns& columns, uint64_t most);

// These call `go_on` between blocks of rows; an error of `go_on` ends the call.
// Appends the rows that the rule d4rl keeps.
Status AppendUnderD4rl(const TransitionColumns& all, const std::function<Status()>& go_on,
                       DatasetBuilder* builder);
// ColumnsHash of all rows.
Result<std::string> HashOfRows(const TransitionColumns& all, const std::function<Status()>& go_on);

}  // namespace b4mrl
