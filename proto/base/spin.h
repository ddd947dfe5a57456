// Decides whether a thread that waits for another process should look again and again (spin) before
// it sleeps.
//
// Waking a sleeping thread of an idle core costs kWakeUp, several times what a simulation step
// takes. So a wait that will probably end within the budget is spun away, and a longer wait is
// slept through: by the ski-rental argument, a budget of about one wake-up costs at most twice the
// best choice. The spinner learns the usual length of waits.
//
// Between looks it yields its core, because the kernel often puts both processes on one core. On a
// busy machine a yield hands the core to a third process for milliseconds. So after such a loss the
// spinner rests for many times as long as that took, which bounds what spinning can cost to a few
// percent. After a spin in vain, which took nothing from anybody, it rests for a shorter time.
//
// Thread rule: one thread.
#pragma once

#if defined(__x86_64__)
#include <immintrin.h>
#endif

#include <sched.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <utility>

#include "proto/base/clock.h"
#include "proto/base/cores.h"

namespace b4mrl {

// What it takes until a sleeping thread of an idle core runs, as measured.
inline constexpr auto kWakeUp = std::chrono::microseconds(60);

// The budget that a process should spin with when it is allowed `longest_us`: none where it may use
// a single core, since its peer cannot run while it spins.
inline std::chrono::microseconds SpinBudget(uint32_t longest_us) {
  return std::chrono::microseconds(AvailableCores().size() > 1 ? longest_us : 0);
}

class Spinner {
 public:
  // `budget`: the longest spin of one wait (SpinBudget); 0 turns spinning off.
  explicit Spinner(std::chrono::microseconds budget) : budget_(budget) {}

  // Whether a wait that began at `since` may still be spun at `now`.
  bool MaySpin(Clock::time_point since, Clock::time_point now) const {
    return now - since < budget_ && now >= rests_until_ && usual_wait_ - kWakeUp <= budget_;
  }

  // Calls `is_over` until it returns true, or the wait that began at `since` has used up the
  // budget, or for `slice` at most. Returns whether the wait is over.
  template <typename IsOver>
  bool Spin(Clock::time_point since, IsOver is_over,
            Clock::duration slice = std::chrono::seconds(1)) {
    Clock::time_point now = Clock::now();
    const Clock::time_point end = now + slice;
    while (MaySpin(since, now) && now < end) {
      for (int i = 0; i < kLooks && !is_over(); ++i) Pause();
      if (is_over()) break;
      // The peer may wait for this very core.
      sched_yield();
      const Clock::time_point last = std::exchange(now, Clock::now());
      if (now - last > kLostSlice) {
        rests_until_ = now + kRestsAfterLoss * (now - last);
      } else if (now - since >= budget_ && !is_over()) {
        rests_until_ = now + kRestsInVain * budget_;
      }
    }
    return is_over();
  }

  // To be called after each wait with its length, however it was spent.
  void Learn(Clock::duration waited) {
    usual_wait_ += (std::min<Clock::duration>(waited, kLongestLearnt) - usual_wait_) / kMemory;
  }

 private:
  // Two looks that are further apart than this: a third process had the core in between, since the
  // peer takes less time for whatever is worth a spin.
  static constexpr auto kLostSlice = std::chrono::microseconds(500);
  static constexpr int kRestsAfterLoss = 32;  // times the loss
  static constexpr int kRestsInVain = 8;      // times the budget
  // Longer waits count as this, so that a client that comes back is met by spinning again soon.
  static constexpr auto kLongestLearnt = std::chrono::microseconds(500);
  static constexpr int kMemory = 8;  // waits
  static constexpr int kLooks = 16;  // between two yields, about 1 us

  static void Pause() {
#if defined(__x86_64__)
    _mm_pause();
#endif
  }

  std::chrono::microseconds budget_;
  Clock::duration usual_wait_{};
  Clock::time_point rests_until_{};
};

}  // namespace b4mrl
