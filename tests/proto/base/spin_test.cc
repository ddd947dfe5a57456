#include "proto/base/spin.h"

#include <catch2/catch.hpp>

namespace b4mrl {
namespace {

using std::chrono::hours;
using std::chrono::microseconds;

constexpr microseconds kBudget(100);

// Whether a wait that begins at `now` would be spun.
bool Spins(const Spinner& spinner, Clock::time_point now = Clock::now()) {
  return spinner.MaySpin(now, now);
}

TEST_CASE("A wait is spun until it is over") {
  Spinner spinner(std::chrono::seconds(100));
  int looks = 0;  // fewer than between two yields, in which a busy machine may take the core away
  REQUIRE(spinner.Spin(Clock::now(), [&] { return ++looks >= 10; }));
}

TEST_CASE("A wait is spun for its budget at most") {
  const Spinner spinner(kBudget);
  const Clock::time_point since = Clock::now();
  REQUIRE(spinner.MaySpin(since, since));
  REQUIRE(spinner.MaySpin(since, since + kBudget - microseconds(1)));
  REQUIRE_FALSE(spinner.MaySpin(since, since + kBudget));
  REQUIRE_FALSE(Spins(Spinner({})));
}

TEST_CASE("Long waits are slept through until short ones come again") {
  Spinner spinner(kBudget);
  for (int i = 0; i < 30; ++i) spinner.Learn(hours(1));
  REQUIRE_FALSE(Spins(spinner));
  for (int i = 0; i < 30; ++i) spinner.Learn(microseconds(20));
  REQUIRE(Spins(spinner));
}

TEST_CASE("After a spin in vain the spinner rests for a time") {
  // The rest takes several times as long, which outlasts what a busy machine puts before the look.
  Spinner spinner(std::chrono::milliseconds(50));
  const Clock::time_point since = Clock::now();
  REQUIRE_FALSE(spinner.Spin(since, [] { return false; }));
  const Clock::time_point end = Clock::now();
  REQUIRE_FALSE(Spins(spinner, end));
  REQUIRE(Spins(spinner, end + hours(1)));
}

}  // namespace
}  // namespace b4mrl
