#include "server/worker/throughput_slice.h"

#include <sched.h>
#include <sys/syscall.h>
#include <unistd.h>

namespace b4mrl {
namespace {

constexpr uint64_t kSliceNs = 100'000'000;  // the longest that the kernel grants

// The kernel's struct sched_attr in its first version, which glibc does not declare.
struct Attributes {
  uint32_t size = sizeof(Attributes);
  uint32_t policy = SCHED_OTHER;
  uint64_t flags = 0;
  int32_t niceness = 0;
  uint32_t priority = 0;
  uint64_t runtime_ns = 0;  // of SCHED_OTHER: the slice
  uint64_t deadline_ns = 0;
  uint64_t period_ns = 0;
};

bool Get(Attributes* attributes) {
  return syscall(SYS_sched_getattr, 0, attributes, sizeof(*attributes), 0) == 0;
}

bool Set(int32_t niceness, uint64_t slice_ns) {
  Attributes attributes;
  attributes.niceness = niceness;  // unchanged: no call sets the slice alone
  attributes.runtime_ns = slice_ns;
  return syscall(SYS_sched_setattr, 0, &attributes, 0) == 0;
}

}  // namespace

ScopedThroughputSlice::ScopedThroughputSlice() {
  Attributes before;
  if (!Get(&before) || before.policy != SCHED_OTHER || before.runtime_ns == 0) return;
  niceness_ = before.niceness;
  slice_ns_ = before.runtime_ns;
  active_ = Set(niceness_, kSliceNs);
}

ScopedThroughputSlice::~ScopedThroughputSlice() {
  if (active_) Set(niceness_, slice_ns_);
}

uint64_t SchedulerSliceNs() {
  Attributes attributes;
  return Get(&attributes) ? attributes.runtime_ns : 0;
}

}  // namespace b4mrl
