#include "client/lane_numbers.h"

#include <array>
#include <catch2/catch.hpp>
#include <vector>

namespace b4mrl {
namespace {

using Outcome = LaneNumbers::Outcome;
using Lanes = std::vector<uint32_t>;

// Begins and ends one operation; the numbers that it carried.
std::vector<uint64_t> Run(LaneNumbers& numbers, const Lanes& lanes, Outcome outcome) {
  std::vector<uint64_t> carried(numbers.CountOf(lanes));
  REQUIRE(numbers.Begin(lanes, carried).ok());
  numbers.End(lanes, outcome);
  return carried;
}

StatusCode TryBegin(LaneNumbers& numbers, const Lanes& lanes) {
  std::vector<uint64_t> carried(numbers.CountOf(lanes));
  return numbers.Begin(lanes, carried).code();
}

TEST_CASE("each lane counts its own operations from 1") {
  LaneNumbers numbers(3);
  CHECK(Run(numbers, {}, Outcome::kExecuted) == std::vector<uint64_t>{1, 1, 1});
  CHECK(Run(numbers, {2, 0}, Outcome::kExecuted) == std::vector<uint64_t>{2, 2});
  CHECK(Run(numbers, {}, Outcome::kExecuted) == std::vector<uint64_t>{3, 2, 3});
}

TEST_CASE("a number that was not executed is used again") {
  LaneNumbers numbers(2);
  CHECK(Run(numbers, {1}, Outcome::kNotExecuted) == std::vector<uint64_t>{1});
  CHECK(Run(numbers, {}, Outcome::kExecuted) == std::vector<uint64_t>{1, 1});
}

TEST_CASE("a lane whose operation may have been executed is lost, others go on") {
  LaneNumbers numbers(2);
  Run(numbers, {0}, Outcome::kUnknown);
  CHECK(TryBegin(numbers, {0}) == StatusCode::kFailedPrecondition);
  CHECK(TryBegin(numbers, {}) == StatusCode::kFailedPrecondition);
  CHECK(Run(numbers, {1}, Outcome::kExecuted) == std::vector<uint64_t>{1});
}

TEST_CASE("a lane has one request under way") {
  LaneNumbers numbers(3);
  std::array<uint64_t, 1> carried{};
  const Lanes lane = {1};
  REQUIRE(numbers.Begin(lane, carried).ok());
  CHECK(TryBegin(numbers, {0, 1, 2}) == StatusCode::kBusy);
  CHECK(TryBegin(numbers, {}) == StatusCode::kBusy);
  // Those refusals kept no lane busy.
  CHECK(TryBegin(numbers, {0, 2}) == StatusCode::kOk);
  numbers.End(lane, Outcome::kExecuted);
  CHECK(Run(numbers, {1}, Outcome::kExecuted) == std::vector<uint64_t>{2});
}

TEST_CASE("a lane that does not exist or is named twice is refused") {
  LaneNumbers numbers(2);
  CHECK(TryBegin(numbers, {0, 2}) == StatusCode::kInvalidArgument);
  CHECK(TryBegin(numbers, {0, 0}) == StatusCode::kBusy);
  CHECK(TryBegin(numbers, {0}) == StatusCode::kOk);
}

TEST_CASE("a session without lanes has nothing to step") {
  LaneNumbers numbers(0);
  CHECK(TryBegin(numbers, {}) == StatusCode::kFailedPrecondition);
}

TEST_CASE("only refusals before execution free a number") {
  for (const StatusCode code :
       {StatusCode::kInvalidArgument, StatusCode::kBusy, StatusCode::kDeadlineExceeded,
        StatusCode::kLimitExceeded, StatusCode::kFailedPrecondition, StatusCode::kUnsupported}) {
    CHECK(OutcomeOfRefusal(Status(code, "")) == Outcome::kNotExecuted);
  }
  for (const StatusCode code : {StatusCode::kInternal, StatusCode::kGap, StatusCode::kStale,
                                StatusCode::kSessionLost, StatusCode::kDataLoss}) {
    CHECK(OutcomeOfRefusal(Status(code, "")) == Outcome::kUnknown);
  }
}

}  // namespace
}  // namespace b4mrl
