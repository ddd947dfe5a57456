// The processor, its cores that a thread may use, and pinning threads to cores. Any thread.
#pragma once

#include <string>
#include <vector>

namespace b4mrl {

// The processor's name as the kernel gives it: "AMD EPYC 9B14"; "unknown processor" without one.
std::string ProcessorName();
// The numbers of the cores that the calling thread may use, ascending; never empty. Call it before
// the thread is pinned.
std::vector<int> AvailableCores();
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
