// What of the machine a process may use, its processor's name, and pinning threads to cores. Any
// thread.
#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

namespace b4mrl {

// The processor's name as the kernel gives it: "AMD EPYC 9B14"; "unknown processor" without one.
std::string ProcessorName();
// The numbers of the cores that the calling thread may use, ascending; never empty. Call it before
// the thread is pinned.
std::vector<int> AvailableCores();

// What the control groups around a process allow it: those of its container, its Slurm job or its
// systemd unit. Processors are processor time in seconds a second.
struct GroupLimits {
  double processors = std::numeric_limits<double>::infinity();
  uint64_t memory_bytes = std::numeric_limits<uint64_t>::max();
};
// Reads them, of cgroup versions 1 and 2, from proc/self/cgroup and sys/fs/cgroup below `root`.
// What cannot be read limits nothing.
GroupLimits ReadGroupLimits(const std::string& root = "/");
// The threads that can compute at once: as many as there are available cores, but no more than
// control groups allow, rounded up, or than Slurm has granted the job on this node
// ($SLURM_CPUS_ON_NODE): clusters that confine no job to its cores expect it to be modest. At least
// 1.
uint32_t ProcessorCount();
// The machine's memory, or what control groups allow of it.
uint64_t MemoryBytes();

// Pins the calling thread, and the threads that it starts from now on, to these cores. A failure is
// ignored, since it only costs speed.
void PinThisThread(const std::vector<int>& cores);

// Pins the calling thread to one core for as long as this object lives; then the thread may use its
// earlier cores again. Threads that it started meanwhile stay pinned.
class ScopedPin {
 public:
  explicit ScopedPin(int core) : before_(AvailableCores()) { PinThisThread({core}); }
  ~ScopedPin() { PinThisThread(before_); }
  ScopedPin(const ScopedPin&) = delete;
  ScopedPin& operator=(const ScopedPin&) = delete;

 private:
  std::vector<int> before_;
};

}  // namespace b4mrl
