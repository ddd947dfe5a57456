// How a thread that computes long rows of work lets others that wake up go first.
#pragma once

#include <cstdint>

namespace b4mrl {

// While it lives, the calling thread asks the kernel for turns of 100 ms instead of about 2 ms.
// Linux (6.12 and later) lets a thread with shorter turns interrupt one with longer turns as soon
// as it wakes up; otherwise it may wait for the end of a scheduler tick, 4 ms, at each of the six
// wake-ups of a round trip. Shares of the processor stay as they are: longer turns come less often.
// Where the kernel knows no such request, refuses it, or the user has chosen another scheduling
// policy, nothing changes. Any thread; costs about a microsecond.
class ScopedThroughputSlice {
 public:
  ScopedThroughputSlice();
  ~ScopedThroughputSlice();
  ScopedThroughputSlice(const ScopedThroughputSlice&) = delete;
  ScopedThroughputSlice& operator=(const ScopedThroughputSlice&) = delete;

 private:
  bool active_ = false;
  int32_t niceness_ = 0;
  uint64_t slice_ns_ = 0;  // before
};

// Of the calling thread, in ns; 0 where the kernel does not say. For tests.
uint64_t SchedulerSliceNs();

}  // namespace b4mrl
