// Pieces whose items have become dearer end early, and the cost of their items is learnt at once.
#include "server/scheduling/piece_timer.h"

#include <catch2/catch.hpp>

namespace b4mrl {
namespace {

using std::chrono::microseconds;

// Clocks that the tests move on.
std::chrono::nanoseconds time_now{}, processor_now{};
int looks = 0, processor_looks = 0;
constexpr PieceTimer::Clocks kClocks = {
    .now =
        [] {
          ++looks;
          return Clock::time_point(time_now);
        },
    .processor_time =
        [] {
          ++processor_looks;
          return processor_now;
        },
};

// Whether the thread that executes an item computes all the while, or waits for its processor.
enum class Time { kComputing, kInterrupted };

// Executes a piece of `items` items that take `item` each, and returns how many were executed.
uint32_t Execute(ItemCost& cost, uint32_t items, microseconds item, Time time = Time::kComputing) {
  looks = processor_looks = 0;
  PieceTimer timer(cost, items, kClocks);
  while (timer.BeginItem()) {
    time_now += item;
    if (time == Time::kComputing) processor_now += item;
  }
  return timer.Finish();
}

TEST_CASE("Items that take what they took before are all executed") {
  ItemCost cost;
  cost.Observe(10);
  REQUIRE(Execute(cost, 50, microseconds(10)) == 50);
  REQUIRE(cost.Expect(1) == Approx(10));
  REQUIRE(Execute(cost, 10, microseconds(30)) == 10);  // interrupted a little
}

TEST_CASE("A piece of one item looks at no clock but before and after it") {
  ItemCost cost;
  cost.Observe(10);
  REQUIRE(Execute(cost, 1, microseconds(10)) == 1);
  REQUIRE(looks == 2);
  REQUIRE(processor_looks == 0);
  REQUIRE(Execute(cost, 1, microseconds(1'900'000)) == 1);  // there is nothing to put back
}

TEST_CASE("Only the processor time of a piece behind one that ended early is measured") {
  ItemCost cost;
  cost.Observe(10);
  REQUIRE(Execute(cost, 50, microseconds(10)) == 50);
  REQUIRE(looks == 51);
  REQUIRE(processor_looks == 0);
  REQUIRE(Execute(cost, 50, microseconds(1900)) == 2);
  REQUIRE(processor_looks == 0);
  REQUIRE(Execute(cost, 50, microseconds(1900)) == 2);
  REQUIRE(processor_looks == 2);
  REQUIRE(Execute(cost, 1, microseconds(10)) == 1);
  REQUIRE_FALSE(cost.is_suspected());
}

TEST_CASE("After an item of more than 2 ms, single items are measured as well") {
  ItemCost cost;
  for (int i = 0; i < 200; ++i) cost.Observe(10);
  REQUIRE(Execute(cost, 1, microseconds(50'000)) == 1);
  REQUIRE(processor_looks == 0);
  REQUIRE_FALSE(cost.too_long_for_bites());
  REQUIRE(Execute(cost, 1, microseconds(50'000), Time::kInterrupted) == 1);
  REQUIRE(processor_looks == 2);
  for (int i = 0; i < 200; ++i) cost.Observe(10);
  REQUIRE_FALSE(cost.too_long_for_bites());
  REQUIRE(Execute(cost, 1, microseconds(50'000)) == 1);
  for (int i = 0; i < 200; ++i) cost.Observe(10);
  REQUIRE(cost.too_long_for_bites());
}

TEST_CASE("Items that become ten thousand times dearer hold their thread for one item each time") {
  ItemCost cost;
  cost.Observe(10);
  REQUIRE(Execute(cost, 10, microseconds(90'000)) == 1);
  REQUIRE_FALSE(cost.too_long_for_bites());
  REQUIRE(Execute(cost, 10, microseconds(90'000)) == 1);
  // Learnt at once, so no third piece has more than one of them.
  REQUIRE(cost.Expect(1) == Approx(90'000));
  REQUIRE(cost.too_long_for_bites());
  REQUIRE(cost.ItemsPerPiece(4096, 2) == 1);
}

TEST_CASE("A piece goes on for four times what it was meant to take") {
  ItemCost cost;
  cost.Observe(10);
  REQUIRE(Execute(cost, 50, microseconds(100)) == 20);  // 2 ms
  ItemCost other;
  other.Observe(10);
  REQUIRE(Execute(other, 10, microseconds(100)) == 4);  // 0.4 ms
  ItemCost share;
  share.Observe(10);
  REQUIRE(Execute(share, 2, microseconds(399)) == 2);  // not less than for a bite
  // Another thread has learnt the new cost since the piece was cut.
  ItemCost dear;
  dear.Observe(100'000);
  REQUIRE(Execute(dear, 50, microseconds(100'000)) == 1);
}

TEST_CASE("A thread that is interrupted again and again does not make its items dear") {
  ItemCost cost;
  cost.Observe(10);
  for (int i = 0; i < 3; ++i) {
    REQUIRE(Execute(cost, 50, microseconds(4000), Time::kInterrupted) == 1);
    REQUIRE(Execute(cost, 49, microseconds(10)) == 49);
  }
  REQUIRE(cost.Expect(1) < 50);
  REQUIRE_FALSE(cost.too_long_for_bites());
}

TEST_CASE("One item of more than a tenth of a second keeps all from bites, with many cheap ones") {
  ItemCost cost;
  cost.Observe(10);
  time_now = {};
  PieceTimer timer(cost, 50, kClocks);
  for (int item = 0; timer.BeginItem(); ++item) {
    time_now += item < 40 ? microseconds(10) : microseconds(110'000);
  }
  REQUIRE(timer.Finish() == 41);
  REQUIRE(cost.Expect(1) < 500);
  REQUIRE(cost.too_long_for_bites());
}

}  // namespace
}  // namespace b4mrl
