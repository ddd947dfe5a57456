#include "server/scheduling/item_cost.h"

#include <catch2/catch.hpp>

namespace b4mrl {
namespace {

TEST_CASE("Pieces last at most half a millisecond and leave other threads their share") {
  ItemCost cost;
  cost.Observe(10);  // microseconds
  REQUIRE(cost.ItemsPerPiece(4096, 1) == 50);
  REQUIRE(cost.ItemsPerPiece(4096, 2) == 50);
  REQUIRE(cost.ItemsPerPiece(64, 2) == 16);
  REQUIRE(cost.ItemsPerPiece(16, 2) == 4);
  REQUIRE(cost.ItemsPerPiece(64, 64) == 2);  // shorter ones cost more to hand out than they gain
  REQUIRE(cost.ItemsPerPiece(1, 2) == 1);
  REQUIRE(cost.ItemsPerBite() == 10);  // 0.1 ms
  for (int i = 0; i < 200; ++i) cost.Observe(1000);
  REQUIRE(cost.ItemsPerPiece(4096, 2) == 1);
  REQUIRE(cost.ItemsPerBite() == 1);
}

TEST_CASE("A thread is woken for as much work as waking costs") {
  ItemCost cost;
  cost.Observe(10);  // microseconds
  REQUIRE(cost.ThreadsFor(1, 4) == 1);
  REQUIRE(cost.ThreadsFor(6, 4) == 1);
  REQUIRE(cost.ThreadsFor(7, 4) == 2);
  REQUIRE(cost.ThreadsFor(64, 4) == 4);
  REQUIRE(cost.ThreadsFor(64, 64) == 11);
}

TEST_CASE(
    "An item that nobody has measured is taken alone, expected to cost nothing, and no bite") {
  const ItemCost cost;
  REQUIRE(cost.ItemsPerPiece(4096, 2) == 1);
  REQUIRE(cost.ThreadsFor(3, 4) == 3);
  REQUIRE(cost.ItemsPerBite() == 1);
  REQUIRE(cost.Expect(5) == 0);
  REQUIRE(cost.too_long_for_bites());
}

TEST_CASE("One interruption counts for little, and a few costly items for what they are") {
  ItemCost cost;
  cost.Observe(20);
  cost.Observe(4000);
  REQUIRE(cost.Expect(1) < 100);
  REQUIRE_FALSE(cost.too_long_for_bites());
  for (int i = 0; i < 3; ++i) cost.Observe(4000);
  REQUIRE(cost.too_long_for_bites());
  REQUIRE(cost.ItemsPerPiece(4096, 2) == 1);
}

TEST_CASE("After an item of more than a tenth of a second, none is a bite for a while") {
  ItemCost cost;
  for (int i = 0; i < 20; ++i) cost.Observe(20);
  cost.Observe(90'000);
  REQUIRE_FALSE(cost.too_long_for_bites());
  cost.Observe(110'000);
  REQUIRE(cost.too_long_for_bites());
  for (int i = 0; i < 200; ++i) cost.Observe(20);
  REQUIRE(cost.Expect(1) < 100);
  REQUIRE(cost.too_long_for_bites());
}

TEST_CASE(
    "A second long item counts by its processor time, which tells it from an interrupted one") {
  for (const double processor_us : {100.0, 90'000.0}) {
    CAPTURE(processor_us);
    ItemCost cost;
    for (int i = 0; i < 200; ++i) cost.Observe(20);
    REQUIRE_FALSE(cost.is_suspected());
    cost.Observe(90'000);
    REQUIRE_FALSE(cost.too_long_for_bites());
    for (int i = 0; i < 200; ++i) cost.Observe(20, 20);
    REQUIRE(cost.is_suspected());  // for a second, however many cheap ones come between
    cost.Observe(90'000, processor_us);
    for (int i = 0; i < 200; ++i) cost.Observe(20, 20);
    REQUIRE(cost.Expect(1) < 100);
    REQUIRE(cost.too_long_for_bites() == (processor_us > 2'000));
  }
}

TEST_CASE("Costly items among many cheap ones stay known") {
  ItemCost cost;
  for (int i = 0; i < 200; ++i) cost.Observe(i % 10 == 0 ? 8000 : 20);
  REQUIRE(cost.Expect(1) > 200);
}

}  // namespace
}  // namespace b4mrl
