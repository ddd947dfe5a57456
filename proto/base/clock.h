// Monotonic time and deadlines. A Deadline travels as remaining milliseconds, so that two machines
// need no common clock, and becomes an absolute point in time on arrival. Value types.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>

namespace b4mrl {

using Clock = std::chrono::steady_clock;

inline double SecondsSince(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

inline int64_t MicrosecondsBetween(Clock::time_point start, Clock::time_point end) {
  return std::chrono::duration_cast<std::chrono::microseconds>(end - start).count();
}

class Deadline {
 public:
  static Deadline After(std::chrono::milliseconds duration) {
    return Deadline(Clock::now() + duration);
  }
  static Deadline AfterMs(int64_t milliseconds) {
    return After(std::chrono::milliseconds(milliseconds));
  }
  bool expired() const { return Clock::now() >= at_; }
  Clock::time_point at() const { return at_; }
  // The time left in ms, never negative; rounded up, so that a wait of this length does not end
  // before the deadline.
  int64_t remaining_ms() const {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(at_ - Clock::now()).count();
    return std::max<int64_t>(left, 0);
  }

 private:
  explicit Deadline(Clock::time_point at) : at_(at) {}
  Clock::time_point at_;
};

}  // namespace b4mrl
