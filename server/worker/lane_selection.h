// Which lanes a request names, and which of them it executes. Pure functions; socket's thread.
#pragma once

#include <cstdint>
#include <vector>

#include "proto/base/status.h"
#include "proto/wire/frame.h"
#include "server/worker/session.h"

namespace b4mrl {

struct LaneSelection {
  std::vector<uint32_t> lanes;     // of the session, in the request's order, no repetition
  std::vector<uint32_t> execute;   // positions in `lanes` that are to be executed
  std::vector<uint32_t> answered;  // the other positions, whose outcome is in the lane's slot
};

// The array `lanes`, or all lanes where it is absent. Refuses sessions without lanes, lanes out of
// range and repeated ones.
Result<std::vector<uint32_t>> ReadLanes(const ArrayReader& arrays, const Session& session);
// Reads the arrays `lanes` and `numbers` and judges `operation` for each lane (JudgeLane). If a
// lane is refused, so is the whole request, with the first such lane's error.
Result<LaneSelection> SelectLanes(const ArrayReader& arrays, Session& session, Operation operation);

// Writes `values` as row `index` of the float32 or float64 array that begins at `offset` of the
// payload and has values.size() elements a row.
void WriteRow(Frame& payload, size_t offset, DType dtype, size_t index,
              std::span<const double> values);

}  // namespace b4mrl
