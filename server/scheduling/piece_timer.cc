#include "server/scheduling/piece_timer.h"

#include <time.h>

namespace b4mrl {
namespace {

double Us(std::chrono::nanoseconds duration) {
  return std::chrono::duration<double, std::micro>(duration).count();
}

}  // namespace

std::chrono::nanoseconds ThreadProcessorTime() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return std::chrono::seconds(time.tv_sec) + std::chrono::nanoseconds(time.tv_nsec);
}

PieceTimer::PieceTimer(ItemCost& cost, uint32_t items, Clocks clocks)
    : cost_(cost), items_(items), clocks_(clocks), start_(clocks.now()), item_start_(start_) {
  if (cost.is_suspected()) processor_start_ = clocks.processor_time();
  if (items == 1) return;  // which is executed, whatever it takes
  too_late_ = start_ + cost.LongestPiece(items);
}

bool PieceTimer::BeginItem() {
  if (begun_ == items_) return false;
  if (begun_ > 0) {
    const Clock::time_point now = clocks_.now();
    if (now >= too_late_) return false;
    item_start_ = now;
  }
  ++begun_;
  return true;
}

uint32_t PieceTimer::Finish() {
  const Clock::time_point end = clocks_.now();
  const double us = Us(end - start_);
  std::optional<double> processor_us;  // of an item
  if (processor_start_) processor_us = Us(clocks_.processor_time() - *processor_start_) / begun_;
  if (begun_ == items_) {
    cost_.Observe(us / begun_, processor_us);
    return begun_;
  }
  ItemCost::Overrun overrun;
  overrun.us_per_item = (us + cost_.Expect(items_ - begun_)) / items_;
  overrun.last_item_us = Us(end - item_start_);
  overrun.processor_us_per_item = processor_us;
  cost_.ObserveOverrun(overrun);
  return begun_;
}

}  // namespace b4mrl
