#include "server/work_queue.h"

#include <atomic>
#include <catch2/catch.hpp>
#include <memory>
#include <string>
#include <thread>
#include <vector>

namespace b4mrl {
namespace {

QueuedWork Work(uint32_t session, Priority priority, uint32_t items, uint32_t items_per_piece = 1) {
  QueuedWork work;
  work.session = session;
  work.priority = priority;
  work.items = items;
  work.items_per_piece = items_per_piece;
  work.items_per_bite = items_per_piece;
  work.deadline = Deadline::AfterMs(1'000'000);
  return work;
}

// The sessions of the next `count` pieces, in order.
std::string Order(WorkQueue& queue, int count) {
  std::string order;
  for (int i = 0; i < count; ++i) {
    const std::optional<Piece> piece = queue.TryTakeBite();
    order += piece ? std::to_string(piece->work->session) : "-";
  }
  return order;
}

TEST_CASE("Sessions take turns, piece by piece") {
  WorkQueue queue;
  QueuedWork greedy = Work(1, Priority::kLanes, 4);
  QueuedWork modest = Work(2, Priority::kLanes, 2);
  QueuedWork late = Work(3, Priority::kLanes, 1);
  queue.Push(&greedy);
  queue.Push(&modest);
  queue.Push(&late);
  REQUIRE(Order(queue, 8) == "1231211-");
  REQUIRE(queue.empty());
}

TEST_CASE("Steps overtake queries, and queries everything else, even when they come later") {
  WorkQueue queue;
  QueuedWork other = Work(1, Priority::kOther, 2);
  QueuedWork query = Work(2, Priority::kQuery, 2);
  QueuedWork step = Work(3, Priority::kLanes, 1);
  queue.Push(&other);
  queue.Push(&query);
  REQUIRE(Order(queue, 1) == "2");
  queue.Push(&step);
  REQUIRE(Order(queue, 5) == "3211-");
}

TEST_CASE("The requests of one session keep their order, and pieces cover every item once") {
  WorkQueue queue;
  QueuedWork first = Work(1, Priority::kQuery, 5, 2);
  QueuedWork second = Work(1, Priority::kQuery, 1, 2);
  queue.Push(&first);
  queue.Push(&second);
  std::vector<std::pair<uint32_t, uint32_t>> pieces;
  while (const std::optional<Piece> piece = queue.TryTakeBite()) {
    REQUIRE_FALSE(piece->expired);
    REQUIRE(piece->work == (pieces.size() < 3 ? &first : &second));
    pieces.emplace_back(piece->first, piece->count);
  }
  REQUIRE(pieces == std::vector<std::pair<uint32_t, uint32_t>>{{0, 2}, {2, 2}, {4, 1}, {0, 1}});
}

TEST_CASE(
    "The pool cuts pieces from the end of a request, the socket's thread bites from its front") {
  WorkQueue queue;
  QueuedWork work = Work(1, Priority::kLanes, 10, 4);
  work.items_per_bite = 3;
  queue.Push(&work);
  std::vector<std::pair<uint32_t, uint32_t>> pieces;
  for (const bool bite : {true, false, true, false}) {
    const std::optional<Piece> piece = bite ? queue.TryTakeBite() : queue.Take();
    REQUIRE(piece);
    pieces.emplace_back(piece->first, piece->count);
    if (queue.empty()) break;
  }
  REQUIRE(pieces == std::vector<std::pair<uint32_t, uint32_t>>{{0, 3}, {6, 4}, {3, 3}});
}

TEST_CASE("Work whose deadline passed before it began comes out whole and unexecuted") {
  WorkQueue queue;
  QueuedWork late = Work(1, Priority::kLanes, 5);
  late.deadline = Deadline::AfterMs(0);
  queue.Push(&late);
  const std::optional<Piece> piece = queue.TryTakeBite();
  REQUIRE(piece);
  REQUIRE(piece->expired);
  REQUIRE(piece->count == 5);
  REQUIRE(queue.empty());
}

TEST_CASE("Work that has begun is finished after its deadline") {
  WorkQueue queue;
  QueuedWork work = Work(1, Priority::kLanes, 2);
  queue.Push(&work);
  REQUIRE_FALSE(queue.TryTakeBite()->expired);
  work.deadline = Deadline::AfterMs(0);
  const std::optional<Piece> rest = queue.TryTakeBite();
  REQUIRE(rest);
  REQUIRE_FALSE(rest->expired);
  REQUIRE(rest->first == 1);
}

TEST_CASE("Many threads take every item exactly once, and Stop wakes those that sleep") {
  constexpr uint32_t kJobs = 200;
  constexpr uint32_t kItems = 7;
  WorkQueue queue;
  std::vector<std::unique_ptr<QueuedWork>> jobs;
  std::atomic<uint32_t> items{0};
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([&] {
      while (const std::optional<Piece> piece = queue.Take()) items += piece->count;
    });
  }
  for (uint32_t i = 0; i < kJobs; ++i) {
    jobs.push_back(std::make_unique<QueuedWork>(Work(i % 5, Priority::kQuery, kItems, 2)));
    queue.Push(jobs.back().get());
  }
  const Deadline patience = Deadline::AfterMs(30'000);
  while (items < kJobs * kItems && !patience.expired()) std::this_thread::yield();
  queue.Stop();
  for (std::thread& thread : threads) thread.join();
  REQUIRE(items == kJobs * kItems);
}

}  // namespace
}  // namespace b4mrl
