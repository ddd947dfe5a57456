#include "client/lane_numbers.h"

#include <fmt/format.h>

namespace b4mrl {

Status LaneNumbers::CheckRange(std::span<const uint32_t> lanes) const {
  if (lanes_.empty()) {
    return Status(StatusCode::kFailedPrecondition,
                  "the session has no lanes: it was opened with num_envs 0");
  }
  for (const uint32_t lane : lanes) {
    if (lane >= lanes_.size()) {
      return InvalidNumber("lane", lane, fmt::format("0..{}", lanes_.size() - 1));
    }
  }
  return Status();
}

Status LaneNumbers::CheckFree(const Lane& lane) const {
  const size_t index = static_cast<size_t>(&lane - lanes_.data());
  if (lane.state == State::kBusy) {
    return Status(
        StatusCode::kBusy,
        fmt::format("lane {} has a request under way or is named twice; one at a time", index));
  }
  if (lane.state == State::kLost) {
    return Status(StatusCode::kFailedPrecondition,
                  fmt::format("the state of lane {} is not known since a request for it was not "
                              "answered; open a new session",
                              index));
  }
  return Status();
}

Status LaneNumbers::Begin(std::span<const uint32_t> lanes, std::span<uint64_t> numbers) {
  B4MRL_RETURN_IF_ERROR(CheckRange(lanes));
  for (size_t i = 0; i < CountOf(lanes); ++i) {
    Lane& lane = LaneAt(lanes, i);
    if (const Status status = CheckFree(lane); !status.ok()) {
      for (size_t begun = 0; begun < i; ++begun) LaneAt(lanes, begun).state = State::kFree;
      return status;
    }
    lane.state = State::kBusy;
    numbers[i] = lane.last + 1;
  }
  return Status();
}

void LaneNumbers::End(std::span<const uint32_t> lanes, Outcome outcome) {
  const size_t count = CountOf(lanes);
  for (size_t i = 0; i < count; ++i) {
    Lane& lane = LaneAt(lanes, i);
    lane.state = outcome == Outcome::kUnknown ? State::kLost : State::kFree;
    if (outcome == Outcome::kExecuted) ++lane.last;
  }
}

LaneNumbers::Outcome OutcomeOfRefusal(const Status& status) {
  switch (status.code()) {
    case StatusCode::kStale:
    case StatusCode::kGap:
    case StatusCode::kSessionLost:
    case StatusCode::kDataLoss:
    case StatusCode::kIoError:
    case StatusCode::kInternal:
      return LaneNumbers::Outcome::kUnknown;
    default:
      return LaneNumbers::Outcome::kNotExecuted;
  }
}

}  // namespace b4mrl
