// The processor cores that this process may use, and keeping threads on them. Any thread.
#pragma once

#include <vector>

namespace b4mrl {

// Their numbers, ascending; never empty. Of the calling thread: ask before it is pinned.
std::vector<int> AvailableCores();
// Keeps the calling thread, and the threads it starts from now on, on these cores. Failing to is no
// error: it only costs speed.
void PinThisThread(const std::vector<int>& cores);

// The same for as long as this object lives; then the thread may go where it could before. Threads
// started meanwhile stay.
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
