// The average time of one item of work, learnt from the items that were executed. Any thread.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <optional>

#include "proto/base/clock.h"

namespace b4mrl {

class ItemCost {
 public:
  // Learns from executed items, which took `us_per_item` microseconds each, and
  // `processor_us_per_item` of the processor, where that was measured.
  void Observe(double us_per_item, std::optional<double> processor_us_per_item = {});
  // A piece that was ended early, because it took several times as long as it was meant to.
  struct Overrun {
    double us_per_item = 0;  // had the rest of the piece taken what was expected of it
    double last_item_us = 0;
    // What the executed items took of the processor, where that was measured.
    std::optional<double> processor_us_per_item;
  };
  // Learns from a piece that was ended early. Its thread may have been interrupted, so the first
  // such piece counts as any other and raises a suspicion. A second one whose processor time was
  // measured has no other reason than its items, and the cost follows at once.
  void ObserveOverrun(const Overrun& overrun);
  // Whether the last piece was ended early, or an item has taken more than 2 ms in the last second,
  // so that the processor time of the next piece should be measured.
  bool is_suspected() const;
  // How long a piece of `items` may go on beginning items: four times as long as it is expected to
  // take, and from 0.4 to 2 ms.
  std::chrono::microseconds LongestPiece(uint32_t items) const;
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
  // longer, none has been measured yet, or one has taken more than 2 ms of the processor, or 0.1 s
  // by the clock, in the last time that is a hundred times as long.
  bool too_long_for_bites() const;

 private:
  uint32_t ItemsIn(double duration_us) const;
  // Moves the average towards what an item took.
  void Learn(double us_per_item);
  void NoteLongItem(double us, std::optional<double> processor_us);

  std::atomic<float> us_{0};  // 0 before the first Observe
  std::atomic<Clock::time_point> long_until_{Clock::time_point()};
  std::atomic<Clock::time_point> watched_until_{Clock::time_point()};
  std::atomic<bool> suspected_{false};
};

}  // namespace b4mrl
