// The client's counters of each lane's operations, by which the server executes each of them once.
//
// The operations (Step, Reset, Restore) of a lane are numbered 1, 2, 3, ... A request carries the
// next number of every lane that it names, and a lane has at most one request under way. A refused
// request has changed nothing, so its numbers are used again. If no reply came, or an error that
// does not say whether the operation was executed, the lane is lost: its number may be taken and
// must not be given to another operation. Lanes are 0-based; an empty list means all lanes in
// order. Thread rule: one thread.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "proto/base/status.h"

namespace b4mrl {

class LaneNumbers {
 public:
  explicit LaneNumbers(uint32_t lanes) : lanes_(lanes) {}

  size_t CountOf(std::span<const uint32_t> lanes) const {
    return lanes.empty() ? lanes_.size() : lanes.size();
  }
  // kFailedPrecondition for a session without lanes; kInvalidArgument for a lane that does not
  // exist.
  Status CheckRange(std::span<const uint32_t> lanes) const;

  // Marks the lanes busy and writes the numbers of their next operation to `numbers`, one for each
  // lane. Changes nothing on an error: an error of CheckRange, kBusy for a lane that is listed
  // twice or has a request under way, kFailedPrecondition for a lost lane.
  Status Begin(std::span<const uint32_t> lanes, std::span<uint64_t> numbers);

  enum class Outcome : uint8_t { kExecuted, kNotExecuted, kUnknown };
  // Ends the operation that Begin began for the same lanes.
  void End(std::span<const uint32_t> lanes, Outcome outcome);

 private:
  enum class State : uint8_t { kFree, kBusy, kLost };
  struct Lane {
    uint64_t last = 0;  // number of the last executed operation
    State state = State::kFree;
  };
  Status CheckFree(const Lane& lane) const;
  Lane& LaneAt(std::span<const uint32_t> lanes, size_t i) {
    return lanes_[lanes.empty() ? i : lanes[i]];
  }

  std::vector<Lane> lanes_;
};

// Whether a server that answered with the error `status` has executed the request.
LaneNumbers::Outcome OutcomeOfRefusal(const Status& status);

}  // namespace b4mrl
