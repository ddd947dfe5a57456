#include "server/scheduling/item_cost.h"

#include <algorithm>
#include <chrono>

#include "proto/base/spin.h"

namespace b4mrl {
namespace {

constexpr double kPieceUs = 500;
constexpr double kBiteUs = 100;
constexpr double kShortestPieceUs = 20;  // handing out a piece takes a microsecond
constexpr double kShortestItemUs = 0.1;
constexpr double kPatience = 4;  // times what a piece was meant to take
// An average hides single items that take a thousand times as long, with which a client could keep
// the socket's thread. After one of them the thread leaves all items to the pool for a hundred
// times as long, so such items get a hundredth of it. An item that a busy machine has interrupted
// seems long too, so those below kMuchTooLongUs count once the processor time of another one proves
// them.
constexpr double kTooLongUs = 2'000;
constexpr double kMuchTooLongUs = 100'000;
constexpr double kTimesAsLong = 100;
constexpr std::chrono::seconds kWatch(1);

bool IsBefore(const std::atomic<Clock::time_point>& end) {
  const Clock::time_point until = end.load(std::memory_order_relaxed);
  return until != Clock::time_point() && Clock::now() < until;
}

}  // namespace

void ItemCost::Observe(double us_per_item, std::optional<double> processor_us_per_item) {
  NoteLongItem(us_per_item, processor_us_per_item);
  Learn(us_per_item);
  if (suspected_.load(std::memory_order_relaxed)) {
    suspected_.store(false, std::memory_order_relaxed);
  }
}

void ItemCost::ObserveOverrun(const Overrun& overrun) {
  NoteLongItem(overrun.last_item_us, overrun.processor_us_per_item);
  Learn(overrun.us_per_item);
  suspected_.store(true, std::memory_order_relaxed);
  const double proven = overrun.processor_us_per_item.value_or(0);
  if (proven > Expect(1)) us_.store(static_cast<float>(proven), std::memory_order_relaxed);
}

bool ItemCost::is_suspected() const {
  return suspected_.load(std::memory_order_relaxed) || IsBefore(watched_until_);
}

void ItemCost::NoteLongItem(double us, std::optional<double> processor_us) {
  if (us <= kTooLongUs) return;
  Clock::time_point until = Clock::now();
  if (const double proven = us > kMuchTooLongUs ? us : processor_us.value_or(0);
      proven > kTooLongUs) {
    until += std::chrono::microseconds(static_cast<int64_t>(kTimesAsLong * proven));
    long_until_.store(until, std::memory_order_relaxed);
  }
  watched_until_.store(until + kWatch, std::memory_order_relaxed);
}

void ItemCost::Learn(double us_per_item) {
  constexpr double kWeight = 0.1, kMostTimes = 20;
  // Two threads may overwrite each other's update; losing one does no harm.
  const double before = Expect(1);
  double now = std::max(us_per_item, kShortestItemUs);
  // A thread that was interrupted for milliseconds measures its items wrongly, so one measurement
  // counts little; a cost that has really changed is learnt after a few pieces.
  if (before > 0) now = before + kWeight * (std::min(now, kMostTimes * before) - before);
  us_.store(static_cast<float>(now), std::memory_order_relaxed);
}

std::chrono::microseconds ItemCost::LongestPiece(uint32_t items) const {
  // Clamped, because another thread may have learnt a much higher cost since the piece was cut.
  const double meant_us = std::clamp(Expect(items), kBiteUs, kPieceUs);
  return std::chrono::microseconds(static_cast<int64_t>(kPatience * meant_us));
}

double ItemCost::Expect(uint32_t items) const {
  return items * static_cast<double>(us_.load(std::memory_order_relaxed));
}

uint32_t ItemCost::ThreadsFor(uint32_t items, uint32_t threads) const {
  const uint32_t each = ItemsIn(kWakeUp.count());
  return std::min(threads, (items + each - 1) / each);
}

uint32_t ItemCost::ItemsPerPiece(uint32_t left, uint32_t threads) const {
  const double share_us = threads > 1 ? Expect(left) / (2 * threads) : Expect(left);
  return std::min(ItemsIn(std::clamp(share_us, kShortestPieceUs, kPieceUs)), std::max(left, 1u));
}

uint32_t ItemCost::ItemsPerBite() const { return ItemsIn(kBiteUs); }

bool ItemCost::too_long_for_bites() const {
  return Expect(1) == 0 || Expect(1) > kPieceUs || IsBefore(long_until_);
}

uint32_t ItemCost::ItemsIn(double duration_us) const {
  const double us = Expect(1);
  return us == 0 ? 1 : std::max(1u, static_cast<uint32_t>(duration_us / us + 0.5));
}

}  // namespace b4mrl
