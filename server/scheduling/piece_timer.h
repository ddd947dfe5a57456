// The time of one piece of work, watched between its items.
//
// A piece is cut by what such items took lately. Where they suddenly become much dearer (lanes with
// few cars are restored to a hundred cars each), it would take as many times longer, and keep its
// thread from its next piece and the socket's thread from its messages. So whoever executes a piece
// asks before each item whether there is time for it, and hands the rest back (work_queue.h).
//
//   PieceTimer timer(*cost, count);
//   for (uint32_t item = first; timer.BeginItem(); ++item) Execute(item);
//   return timer.Finish();
//
// Thread rule: the thread that executes the piece. A piece costs two looks at the clock, and one
// more for each of its items but the first.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>

#include "proto/base/clock.h"
#include "server/scheduling/item_cost.h"

namespace b4mrl {

// The processor time that the calling thread has had so far.
std::chrono::nanoseconds ThreadProcessorTime();

class PieceTimer {
 public:
  struct Clocks {
    Clock::time_point (*now)() = &Clock::now;
    std::chrono::nanoseconds (*processor_time)() = &ThreadProcessorTime;
  };
  // The piece has `items` items, at least 1, whose cost outlives the timer. It begins now.
  PieceTimer(ItemCost& cost, uint32_t items) : PieceTimer(cost, items, Clocks{}) {}
  PieceTimer(ItemCost& cost, uint32_t items, Clocks clocks);

  // Whether the next item may begin: always the first one, and none once all have begun or the
  // piece has taken several times as long as it was meant to.
  bool BeginItem();
  // To be called after the last item: teaches the cost what the items took, and returns how many
  // were executed.
  uint32_t Finish();

 private:
  ItemCost& cost_;
  const uint32_t items_;
  const Clocks clocks_;
  const Clock::time_point start_;
  // What the thread had had of the processor at the start; where the cost is suspected alone, since
  // the kernel has to be asked.
  std::optional<std::chrono::nanoseconds> processor_start_;
  Clock::time_point item_start_;  // of the last item that has begun
  Clock::time_point too_late_;    // for another item to begin
  uint32_t begun_ = 0;
};

}  // namespace b4mrl
