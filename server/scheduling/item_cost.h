// Average time of one item of work, learnt while working. Any thread.
#pragma once

#include <atomic>
#include <cstdint>

namespace b4mrl {

class ItemCost {
 public:
  // Until the first item was measured, each is taken alone.
  void Observe(double us_per_item);
  // What `items` will probably take; 0 until one was measured.
  double Expect(uint32_t items) const;
  // How many of `items` make one piece: at most half a millisecond of work, and small enough for
  // all `threads` to get some.
  uint32_t ItemsPerPiece(uint32_t items, uint32_t threads) const;
  // Those of a bite: a tenth of a millisecond, the longest that a message waits.
  uint32_t ItemsPerBite() const;
  // Whether one item alone would keep messages waiting for longer than half a millisecond.
  bool too_long_for_bites() const;

 private:
  uint32_t ItemsIn(double duration_us) const;

  std::atomic<float> us_{0};  // 0: none was measured yet
};

}  // namespace b4mrl
