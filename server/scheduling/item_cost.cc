#include "server/scheduling/item_cost.h"

#include <algorithm>

namespace b4mrl {
namespace {

constexpr double kPieceUs = 500;
constexpr double kBiteUs = 100;
constexpr double kShortestPieceUs = 60;  // below this, sharing out costs more than it gains
constexpr double kShortestItemUs = 0.1;

}  // namespace

void ItemCost::Observe(double us_per_item) {
  constexpr double kWeight = 0.1, kMostTimes = 20;
  // Threads may overwrite each other's update; any of them is as good.
  const double before = Expect(1);
  double now = std::max(us_per_item, kShortestItemUs);
  // A thread that was interrupted for milliseconds says little about its items; a cost that has
  // changed is known after a few pieces all the same.
  if (before > 0) now = before + kWeight * (std::min(now, kMostTimes * before) - before);
  us_.store(static_cast<float>(now), std::memory_order_relaxed);
}

double ItemCost::Expect(uint32_t items) const {
  return items * static_cast<double>(us_.load(std::memory_order_relaxed));
}

uint32_t ItemCost::ItemsPerPiece(uint32_t items, uint32_t threads) const {
  const double fair_us = Expect(items) / std::max(threads, 1u);
  return std::min(ItemsIn(std::clamp(fair_us, kShortestPieceUs, kPieceUs)), std::max(items, 1u));
}

uint32_t ItemCost::ItemsPerBite() const { return ItemsIn(kBiteUs); }

bool ItemCost::too_long_for_bites() const { return Expect(1) > kPieceUs; }

uint32_t ItemCost::ItemsIn(double duration_us) const {
  const double us = Expect(1);
  return us == 0 ? 1 : std::max(1u, static_cast<uint32_t>(duration_us / us + 0.5));
}

}  // namespace b4mrl
