#include "server/worker/throughput_slice.h"

#include <sched.h>
#include <sys/resource.h>

#include <catch2/catch.hpp>

namespace b4mrl {
namespace {

TEST_CASE("A thread's turns are long within the scope only, and its niceness stays") {
  const int niceness = getpriority(PRIO_PROCESS, 0);
  const uint64_t before = SchedulerSliceNs();
  {
    const ScopedThroughputSlice slice;
    // Kernels before 6.12 have one slice for all, and report 0.
    CHECK((before == 0 || SchedulerSliceNs() > before));
    CHECK(sched_getscheduler(0) == SCHED_OTHER);
    CHECK(getpriority(PRIO_PROCESS, 0) == niceness);
  }
  CHECK(SchedulerSliceNs() == before);
  CHECK(getpriority(PRIO_PROCESS, 0) == niceness);
}

}  // namespace
}  // namespace b4mrl
