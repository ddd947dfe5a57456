// Which work the socket's thread leaves to the stand-in.
#include <unistd.h>

#include <atomic>
#include <catch2/catch.hpp>
#include <fstream>
#include <iterator>
#include <string>
#include <thread>

#include "tests/server/scheduling/queued_work.h"

namespace b4mrl {
namespace {

TEST_CASE("Items that are too long for bites are left to the pool and the stand-in") {
  WorkQueue queue(1);
  Cost costly(8000), cheap(20);
  QueuedWork query = Work(1, WorkKind::kQuery, 3, costly);
  QueuedWork step = Work(2, WorkKind::kLanes, 1, cheap);
  queue.Push(&query);
  REQUIRE_FALSE(queue.TryTakeBite());
  REQUIRE(queue.TakeInstead()->work == &query);
  queue.Push(&step);
  REQUIRE(queue.TryTakeBite()->work == &step);
  REQUIRE(Take(queue)->work == &query);
  REQUIRE_FALSE(queue.TryTakeBite());
  REQUIRE(queue.TakeInstead()->work == &query);
  REQUIRE(queue.empty());
}

TEST_CASE("A worker's only thread leaves long items to the stand-in when they are next") {
  WorkQueue queue(1);
  Cost cheap(100);
  ItemCost unknown;
  QueuedWork query = Work(1, WorkKind::kQuery, 1000, cheap);
  QueuedWork step = Work(2, WorkKind::kLanes, 1, unknown);
  queue.Push(&query);
  REQUIRE(queue.TryTakeBite()->work == &query);
  queue.Push(&step);
  REQUIRE(queue.TryTakeBite()->work == &query);
  std::atomic<QueuedWork*> taken = nullptr;
  std::thread stand_in([&] {
    if (const auto piece = queue.TakeInstead()) taken = piece->work;
  });
  const Deadline patience = Deadline::AfterMs(10'000);
  while (taken == nullptr && !patience.expired()) std::this_thread::yield();
  queue.Stop();
  stand_in.join();
  REQUIRE(taken == &step);
}

// Whether the kernel says that a thread of this process waits for something.
bool Waits(pid_t thread) {
  std::ifstream stat("/proc/self/task/" + std::to_string(thread) + "/stat");
  const std::string line(std::istreambuf_iterator<char>(stat), {});
  const size_t state = line.rfind(')') + 2;
  return state < line.size() && line[state] == 'S';
}

TEST_CASE("Items that are too long for the caller wake the pool while the stand-in is at work") {
  WorkQueue queue(2);
  Cost costly(8000);
  QueuedWork first = Work(1, WorkKind::kLanes, 1, costly);
  QueuedWork second = Work(2, WorkKind::kLanes, 1, costly);
  queue.Push(&first);
  REQUIRE_FALSE(queue.TryTakeBite());
  REQUIRE(queue.TakeInstead()->work == &first);  // and is at it
  std::atomic<pid_t> pool_id = 0;
  std::atomic<QueuedWork*> taken = nullptr;
  std::thread pool([&] {
    pool_id = gettid();
    if (const auto piece = Take(queue)) taken = piece->work;
  });
  const Deadline patience = Deadline::AfterMs(10'000);
  while ((pool_id == 0 || !Waits(pool_id)) && !patience.expired()) std::this_thread::yield();
  queue.Push(&second);
  while (taken == nullptr && !patience.expired()) std::this_thread::yield();
  const bool was_woken = taken != nullptr;
  queue.Stop();
  pool.join();
  REQUIRE(was_woken);
  REQUIRE(taken == &second);
}

}  // namespace
}  // namespace b4mrl
