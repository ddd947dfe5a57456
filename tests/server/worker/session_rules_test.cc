// The rule of exactly once, for one lane.
#include <catch2/catch.hpp>

#include "server/worker/session.h"

namespace b4mrl {
namespace {

LaneStatus After(uint64_t committed, Operation operation) {
  return {committed, operation, false, nullptr};
}

TEST_CASE("The next number is executed and the last one answered from the slot") {
  const LaneStatus lane = After(5, Operation::kStep);
  REQUIRE(*JudgeLane(lane, 0, 6, Operation::kStep) == LaneVerdict::kExecute);
  REQUIRE(*JudgeLane(lane, 0, 6, Operation::kReset) == LaneVerdict::kExecute);
  REQUIRE(*JudgeLane(lane, 0, 5, Operation::kStep) == LaneVerdict::kAnswerFromSlot);
}

TEST_CASE("Other numbers are refused with what would have been allowed") {
  const LaneStatus lane = After(5, Operation::kStep);
  const Status stale = JudgeLane(lane, 3, 4, Operation::kStep).status();
  REQUIRE(stale.code() == StatusCode::kStale);
  REQUIRE(stale.message() == "number of lane 3 is 4, allowed: 6 (next) or 5 (last)");
  REQUIRE(JudgeLane(lane, 3, 7, Operation::kStep).status().code() == StatusCode::kGap);
  REQUIRE(JudgeLane(lane, 3, UINT64_MAX, Operation::kStep).status().code() == StatusCode::kGap);
  REQUIRE(JudgeLane(lane, 3, 0, Operation::kStep).status().code() == StatusCode::kStale);
  const LaneStatus fresh = After(0, Operation::kNone);
  REQUIRE(JudgeLane(fresh, 3, 0, Operation::kReset).status().message() ==
          "number of lane 3 is 0, allowed: 1 (next)");
}

TEST_CASE("The last number of another operation is not answered with that one's result") {
  const LaneStatus lane = After(5, Operation::kReset);
  REQUIRE(JudgeLane(lane, 0, 5, Operation::kStep).status().code() == StatusCode::kStale);
  REQUIRE(JudgeLane(After(0, Operation::kNone), 0, 0, Operation::kStep).status().code() ==
          StatusCode::kStale);
}

TEST_CASE("A lane does one thing at a time") {
  LaneStatus lane = After(5, Operation::kStep);
  lane.busy = reinterpret_cast<const RequestJob*>(&lane);
  REQUIRE(JudgeLane(lane, 0, 6, Operation::kStep).status().code() == StatusCode::kBusy);
  REQUIRE(JudgeLane(lane, 0, 5, Operation::kStep).status().code() == StatusCode::kBusy);
}

}  // namespace
}  // namespace b4mrl
