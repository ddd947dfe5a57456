#include "algorithms/experience/training_simulator.h"

#include <atomic>
#include <catch2/catch.hpp>
#include <deque>

namespace b4mrl {
namespace {

// A simulator that refuses as many steps as there are codes, for these reasons, and takes the next
// one.
struct RefusingSimulator {
  std::deque<StatusCode> refusals;
  int steps = 0;

  Result<StepOutcome> Step() {
    ++steps;
    if (refusals.empty()) return StepOutcome();
    const StatusCode code = refusals.front();
    refusals.pop_front();
    return Status(code, "refused");
  }
};

}  // namespace

TEST_CASE("A step that is refused for a reason that passes is sent again until it is taken") {
  const std::atomic<bool> stop = false;
  RefusingSimulator simulator{{StatusCode::kBusy, StatusCode::kLimitExceeded, StatusCode::kBusy}};
  CHECK(UntilTaken([&] { return simulator.Step(); }, stop).ok());
  CHECK(simulator.steps == 4);
}

TEST_CASE("A step after which the lanes are unknown is not sent again") {
  const std::atomic<bool> stop = false;
  for (const StatusCode code : {StatusCode::kUnavailable, StatusCode::kSessionLost}) {
    RefusingSimulator simulator{{code}};
    CHECK(UntilTaken([&] { return simulator.Step(); }, stop).status().code() == code);
    CHECK(simulator.steps == 1);
  }
}

TEST_CASE("A run that is told to stop waits for no refused step") {
  const std::atomic<bool> stop = true;
  RefusingSimulator simulator{{StatusCode::kBusy}};
  const auto outcome = UntilTaken([&] { return simulator.Step(); }, stop);
  CHECK(outcome.status().code() == StatusCode::kUnavailable);
  CHECK(simulator.steps == 1);
}

}  // namespace b4mrl
