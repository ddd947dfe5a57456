#include "server/scheduling/fair_share.h"

#include <catch2/catch.hpp>
#include <string>

namespace b4mrl {
namespace {

constexpr auto kAnybody = [](uint32_t) { return true; };

// The accounts of the next `count` turns of `amount` each.
std::string Turns(FairShare& share, int count, double amount) {
  std::string turns;
  for (int i = 0; i < count; ++i) {
    const std::optional<uint32_t> next = share.Next(kAnybody);
    turns += next ? std::to_string(*next) : "-";
    if (next) share.Serve(*next, amount);
  }
  return turns;
}

TEST_CASE("Whoever has had least goes next, and of equals whoever came first") {
  FairShare share;
  REQUIRE(Turns(share, 1, 1) == "-");
  share.Enter(2);
  share.Enter(0);
  REQUIRE(Turns(share, 4, 1) == "2020");
  share.Correct(2, 2);
  REQUIRE(Turns(share, 4, 1) == "0020");
}

TEST_CASE("Whoever wants nothing for a while saves nothing up") {
  FairShare share;
  share.Enter(1);
  share.Enter(2);
  REQUIRE(Turns(share, 2, 1) == "12");
  share.Leave(2);
  REQUIRE(Turns(share, 100, 1) == std::string(100, '1'));
  share.Enter(2);
  // One turn ahead, not a hundred.
  REQUIRE(Turns(share, 6, 1) == "212121");
}

TEST_CASE("Debts stay while an account wants nothing") {
  FairShare share;
  share.Enter(1);
  share.Serve(1, 10);
  share.Leave(1);
  share.Enter(2);
  share.Enter(1);
  REQUIRE(Turns(share, 12, 1) == "222222222221");
}

TEST_CASE("Forgetting an account cancels its debt and gives it no credit") {
  FairShare share;
  share.Enter(1);
  share.Enter(2);
  share.Serve(1, 10);
  REQUIRE(Turns(share, 4, 1) == "2222");
  share.Forget(1);
  REQUIRE(Turns(share, 5, 1) == "11212");
}

TEST_CASE("Whoever is not admitted is passed over") {
  FairShare share;
  share.Enter(1);
  share.Enter(2);
  REQUIRE(share.Next([](uint32_t account) { return account != 1; }) == 2u);
  REQUIRE_FALSE(share.Next([](uint32_t) { return false; }));
}

}  // namespace
}  // namespace b4mrl
