#include "server/worker/lane_selection.h"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>

namespace b4mrl {

Result<std::vector<uint32_t>> ReadLanes(const ArrayReader& arrays, const Session& session) {
  const uint32_t count = session.lane_count();
  if (count == 0) {
    return Status(StatusCode::kFailedPrecondition,
                  "the session has no lanes: it was opened with num_envs 0");
  }
  std::vector<uint32_t> lanes(count);
  std::iota(lanes.begin(), lanes.end(), 0);
  if (!arrays.Has("lanes")) return lanes;

  B4MRL_ASSIGN_OR_RETURN(const TensorView view,
                         arrays.Require("lanes", {DType::kUint32}, {ArrayReader::kAny}));
  const std::span<const uint32_t> named = view.As<uint32_t>();
  if (named.empty() || named.size() > count) {
    return InvalidNumber("length of lanes", static_cast<double>(named.size()),
                         fmt::format("1..{}", count));
  }
  std::vector<bool> seen(count);
  for (const uint32_t lane : named) {
    if (lane >= count) return InvalidNumber("lane", lane, fmt::format("0..{}", count - 1));
    if (seen[lane]) return InvalidNumber("lane", lane, "each lane once");
    seen[lane] = true;
  }
  lanes.assign(named.begin(), named.end());
  return lanes;
}

Result<LaneSelection> SelectLanes(const ArrayReader& arrays, Session& session,
                                  Operation operation) {
  LaneSelection selection;
  B4MRL_ASSIGN_OR_RETURN(selection.lanes, ReadLanes(arrays, session));
  B4MRL_ASSIGN_OR_RETURN(const TensorView view,
                         arrays.Require("numbers", {DType::kUint64}, {selection.lanes.size()}));
  const std::span<const uint64_t> numbers = view.As<uint64_t>();
  for (uint32_t position = 0; position < selection.lanes.size(); ++position) {
    const uint32_t lane = selection.lanes[position];
    B4MRL_ASSIGN_OR_RETURN(const LaneVerdict verdict,
                           JudgeLane(session.lane(lane), lane, numbers[position], operation));
    (verdict == LaneVerdict::kExecute ? selection.execute : selection.answered).push_back(position);
  }
  return selection;
}

void WriteRow(Frame& payload, size_t offset, DType dtype, size_t index,
              std::span<const double> values) {
  const size_t first = index * values.size();
  if (dtype == DType::kFloat64) {
    double* target = ArrayAt<double>(payload, offset, first + values.size()).data() + first;
    std::copy(values.begin(), values.end(), target);
    return;
  }
  float* target = ArrayAt<float>(payload, offset, first + values.size()).data() + first;
  std::transform(values.begin(), values.end(), target,
                 [](double value) { return static_cast<float>(value); });
}

}  // namespace b4mrl
