// Lets a thread that computes for long be interrupted at once by threads that wake up.
#pragma once

#include <cstdint>

namespace b4mrl {

// While it exists, the calling thread asks the kernel for turns of 100 ms instead of about 2 ms.
// Linux (6.12 and later) lets a thread with shorter turns interrupt a thread with longer turns as
// soon as it wakes up. Without that, a thread that wakes up may wait for the end of a scheduler
// tick, 4 ms, at each of the six wake-ups of a round trip. Shares of the processor do not change,
// as longer turns come less often. Where the kernel knows no such request, refuses it, or the user
// has chosen another scheduling policy, nothing changes. Any thread; costs about a microsecond.
class ScopedThroughputSlice {
 public:
  ScopedThroughputSlice();
  ~ScopedThroughputSlice();
  ScopedThroughputSlice(const ScopedThroughputSlice&) = delete;
  ScopedThroughputSlice& operator=(const ScopedThroughputSlice&) = delete;

 private:
  bool active_ = false;
  int32_t niceness_ = 0;
  uint64_t slice_ns_ = 0;  // the turn before the change
};

// The calling thread's turn in nanoseconds; 0 where the kernel does not say. For tests.
uint64_t SchedulerSliceNs();

}  // namespace b4mrl
