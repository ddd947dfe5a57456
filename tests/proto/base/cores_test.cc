#include "proto/base/cores.h"

#include <sched.h>

#include <catch2/catch.hpp>
#include <thread>

namespace b4mrl {
namespace {

TEST_CASE("A pinned thread stays on its core, and so do the threads that it starts") {
  const std::vector<int> before = AvailableCores();
  REQUIRE_FALSE(before.empty());
  {
    const ScopedPin pin(before.back());
    CHECK(AvailableCores() == std::vector<int>{before.back()});
    CHECK(sched_getcpu() == before.back());
    std::vector<int> of_child;
    std::thread([&] { of_child = AvailableCores(); }).join();
    CHECK(of_child == std::vector<int>{before.back()});
  }
  CHECK(AvailableCores() == before);
}

}  // namespace
}  // namespace b4mrl
