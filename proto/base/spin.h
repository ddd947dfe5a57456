// Decides whether a thread that waits for another process should look again and again (spin) before
// it sleeps.
//
// Waking a sleeping thread of an idle core costs about 60 us, several times what a simulation step
// takes. So a wait that will probably end within the budget is spun away, and a longer wait is
// slept through: by the ski-rental argument, a budget of about one wake-up costs at most twice the
// best choice. The spinner learns the usual length of waits. It rests after a spin that was in
// vain, and after one in which its core was given to another thread: on a busy machine, a spin
// takes time from the very thread that it waits for. Each such spin doubles the rest, each other
// one halves it.
//
// Thread rule: one thread.
#pragma once

#if defined(__x86_64__)
#include <immintrin.h>
#endif

#include <sched.h>

#include <algorithm>
#include <chrono>
#include <utility>

#include "proto/base/clock.h"

namespace b4mrl {

class Spinner {
 public:
  // `budget`: the longest spin of one wait; 0 turns spinning off. A process that may use a single
  // core passes 0, since its peer cannot run while it spins.
  explicit Spinner(std::chrono::microseconds budget) : budget_(budget) {}

  // Whether a wait that began at `since` may still be spun at `now`.
  bool MaySpin(Clock::time_point since, Clock::time_point now) const {
    return now - since < budget_ && now >= rests_until_ && usual_wait_ - kWakeUp <= budget_;
  }

  // Calls `is_over` until it returns true, or for `slice` at most, or until the wait that began at
  // `since` has used up the budget. Returns whether the wait is over.
  template <typename IsOver>
  bool Spin(Clock::time_point since, std::chrono::microseconds slice, IsOver is_over) {
    Clock::time_point now = Clock::now();
    const Clock::time_point end = now + slice;
    while (MaySpin(since, now) && now < end) {
      for (int i = 0; i < kLooks && !is_over(); ++i) Pause();
      if (is_over()) break;
      // The peer may wait for this very core.
      sched_yield();
      const Clock::time_point last = std::exchange(now, Clock::now());
      const bool is_in_vain = now - last > kInterruption || now - since >= budget_;
      if (is_in_vain && !is_over()) Rest(now);
    }
    if (!is_over()) return false;
    rest_ = std::max(rest_ / 2, kShortestRest);
    return true;
  }

  // To be called after each wait with its length, however it was spent.
  void Learn(Clock::duration waited) {
    usual_wait_ += (std::min<Clock::duration>(waited, kLongestLearnt) - usual_wait_) / kMemory;
  }

 private:
  static constexpr auto kWakeUp = std::chrono::microseconds(60);
  // Two looks that are further apart than this: the core was given to another thread in between.
  static constexpr auto kInterruption = std::chrono::microseconds(30);
  static constexpr Clock::duration kShortestRest = std::chrono::milliseconds(1);
  static constexpr Clock::duration kLongestRest = std::chrono::seconds(1);
  // Longer waits count as this, so that a client that comes back is met by spinning again soon.
  static constexpr auto kLongestLearnt = std::chrono::microseconds(500);
  static constexpr int kMemory = 8;  // waits
  static constexpr int kLooks = 16;  // between two yields, about 1 us

  static void Pause() {
#if defined(__x86_64__)
    _mm_pause();
#endif
  }
  void Rest(Clock::time_point now) {
    rests_until_ = now + rest_;
    rest_ = std::min(rest_ * 2, kLongestRest);
  }

  std::chrono::microseconds budget_;
  Clock::duration usual_wait_{};
  Clock::duration rest_ = kShortestRest;
  Clock::time_point rests_until_{};
};

}  // namespace b4mrl
