// When what waits for another process is tried again.
#include "benchmarks/jobs/job_queue.h"

#include <catch2/catch.hpp>
#include <chrono>

namespace b4mrl {
namespace {

TEST_CASE("What waits is tried again at once after a change, and later and later without one") {
  Patience patience;
  CHECK(patience.IsOver(0, 3));
  CHECK(patience.IsOver(1, 2));  // one was begun
  const Clock::time_point start = Clock::now();
  CHECK(patience.IsOver(0, 3));  // it has ended and waits for what follows
  const auto await_next = [&patience] {
    const Deadline far = Deadline::AfterMs(60'000);
    while (!patience.IsOver(0, 3)) REQUIRE_FALSE(far.expired());
    return Clock::now();
  };
  CHECK(await_next() - start >= std::chrono::milliseconds(kJobPollMs));
  CHECK(await_next() - start >= std::chrono::milliseconds(3 * kJobPollMs));
}

}  // namespace
}  // namespace b4mrl
