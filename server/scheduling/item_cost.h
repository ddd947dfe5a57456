// The average time of one item of work, learnt from the items that were executed. Any thread.
#pragma once

#include <atomic>
#include <cstdint>

#include "proto/base/clock.h"

namespace b4mrl {

class ItemCost {
 public:
  // Learns from executed items, which took `us_per_item` microseconds each.
  void Observe(double us_per_item);
  // The microseconds that `items` will probably take; 0 before the first Observe.
  double Expect(uint32_t items) const;
  // How many of `threads` are worth waking for `items`: each should get 60 us of work or more.
  uint32_t ThreadsFor(uint32_t items, uint32_t threads) const;
  // How many of the `left` items of a request make the next piece: at most 0.5 ms of work, and half
  // of a thread's share, so that threads which began at different times end together ("guided
  // self-scheduling", Polychronopoulos and Kuck 1987). 1 before the first Observe.
  uint32_t ItemsPerPiece(uint32_t left, uint32_t threads) const;
  // How many items the socket's thread executes between two looks at the socket: 0.1 ms of work.
  uint32_t ItemsPerBite() const;
  // Whether one item alone might keep messages waiting for longer than 0.5 ms: an item takes
  // longer, none has been measured yet, or one has taken more than 0.1 s in the last ten seconds.
  bool too_long_for_bites() const;

 private:
  uint32_t ItemsIn(double duration_us) const;

  std::atomic<float> us_{0};  // 0 before the first Observe
  std::atomic<Clock::time_point> long_until_{Clock::time_point()};
};

}  // namespace b4mrl
