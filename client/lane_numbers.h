// The numbers by which steps happen exactly once, as the client counts them.
//
// Each lane numbers its operations (Step, Reset, Restore) 1, 2, 3, ...; a request carries the next
// number of every lane that it names, and a lane has at most one request under way. A refused
// request has changed nothing, so its numbers are used again. When no answer came, or one that
// leaves open what was executed, the lane's state is not known and the lane is lost: a number that
// may be taken must not be given to another operation. Lanes are 0-based; an empty list means all
// of them, in order. Thread rule: one thread.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "proto/base/status.h"

namespace b4mrl {

class LaneNumbers {
 public:
  explicit LaneNumbers(uint32_t lanes) : lanes_(lanes) {}

  size_t size() const { return lanes_.size(); }
  size_t CountOf(std::span<const uint32_t> lanes) const {
    return lanes.empty() ? lanes_.size() : lanes.size();
  }
  // kFailedPrecondition for a session without lanes; kInvalidArgument for a lane that does not
  // exist.
  Status CheckRange(std::span<const uint32_t> lanes) const;

  // Marks the lanes busy and writes the numbers of their next operation to `numbers` (one each).
  // Changes nothing on an error: those of CheckRange, kBusy for a lane that is listed twice or has
  // a request under way, kFailedPrecondition for a lost one.
  Status Begin(std::span<const uint32_t> lanes, std::span<uint64_t> numbers);

  enum class Outcome : uint8_t { kExecuted, kNotExecuted, kUnknown };
  // Ends what Begin began for the same lanes.
  void End(std::span<const uint32_t> lanes, Outcome outcome);

 private:
  enum class State : uint8_t { kFree, kBusy, kLost };
  struct Lane {
    uint64_t last = 0;  // the number of its last executed operation
    State state = State::kFree;
  };
  Status CheckFree(const Lane& lane) const;
  Lane& LaneAt(std::span<const uint32_t> lanes, size_t i) {
    return lanes_[lanes.empty() ? i : lanes[i]];
  }

  std::vector<Lane> lanes_;
};

// Whether a server that answered with `status` has executed the request.
LaneNumbers::Outcome OutcomeOfRefusal(const Status& status);

}  // namespace b4mrl
