// Which lanes a request names and what is to be done for each. Pure checks; socket's thread.
#pragma once

#include <cstdint>
#include <vector>

#include "proto/base/status.h"
#include "proto/wire/frame.h"
#include "server/worker/session.h"

namespace b4mrl {

struct LaneSelection {
  std::vector<uint32_t> lanes;    // of the session, in the request's order, no repetition
  std::vector<uint32_t> execute;  // positions in `lanes` that are to be executed
};

// The array `lanes`, or all lanes where it is absent. Refuses sessions without lanes, lanes out of
// range and repeated ones.
Result<std::vector<uint32_t>> ReadLanes(const ArrayReader& arrays, const Session& session);
// The array `numbers`, judged for `operation` on every one of `lanes`; the first lane that is
// refused refuses the request.
Result<LaneSelection> SelectLanes(const ArrayReader& arrays, Session& session, Operation operation);

// Writes doubles to position `index` of rows of `values.size()` elements, as float32 or float64.
void WriteRow(Frame& payload, size_t offset, DType dtype, size_t index,
              std::span<const double> values);

}  // namespace b4mrl
