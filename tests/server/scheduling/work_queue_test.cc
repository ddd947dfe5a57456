#include "server/scheduling/work_queue.h"

#include <algorithm>
#include <atomic>
#include <catch2/catch.hpp>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "tests/server/scheduling/queued_work.h"

namespace b4mrl {
namespace {

// The sessions of the next `count` bites, in order.
std::string Order(WorkQueue& queue, int count) {
  std::string order;
  for (int i = 0; i < count; ++i) {
    const std::optional<Piece> piece = queue.TryTakeBite();
    order += piece ? std::to_string(piece->work->session) : "-";
  }
  return order;
}

TEST_CASE("Sessions take turns, bite by bite") {
  WorkQueue queue(1);
  Cost cost(100);
  QueuedWork greedy = Work(1, WorkKind::kLanes, 4, cost);
  QueuedWork modest = Work(2, WorkKind::kLanes, 2, cost);
  QueuedWork late = Work(3, WorkKind::kLanes, 1, cost);
  queue.Push(&greedy);
  queue.Push(&modest);
  queue.Push(&late);
  REQUIRE(Order(queue, 8) == "1231211-");
  REQUIRE(queue.empty());
}

TEST_CASE("Sessions share the time, whatever the number of their items") {
  WorkQueue queue(1);
  Cost costly(400), cheap(100);
  QueuedWork few = Work(1, WorkKind::kQuery, 100, costly);
  QueuedWork many = Work(2, WorkKind::kQuery, 100, cheap);
  queue.Push(&few);
  queue.Push(&many);
  REQUIRE(Order(queue, 15) == "122221222212222");
}

TEST_CASE("What a piece took counts, not what it was expected to take") {
  WorkQueue queue(1);
  Cost cost(100);
  QueuedWork unlucky = Work(1, WorkKind::kQuery, 100, cost);
  QueuedWork other = Work(2, WorkKind::kQuery, 100, cost);
  queue.Push(&unlucky);
  queue.Push(&other);
  queue.Settle(*queue.TryTakeBite(), 550);
  REQUIRE(Order(queue, 8) == "22222212");
}

TEST_CASE(
    "Steps get two thirds of the time while queries and snapshots want some, and neither starves") {
  WorkQueue queue(1);
  Cost cost(100);
  QueuedWork other = Work(1, WorkKind::kOther, 100, cost);
  QueuedWork query = Work(2, WorkKind::kQuery, 100, cost);
  QueuedWork step = Work(3, WorkKind::kLanes, 100, cost);
  QueuedWork second_step = Work(4, WorkKind::kLanes, 100, cost);
  for (QueuedWork* work : {&other, &query, &step, &second_step}) queue.Push(work);
  std::string order = Order(queue, 60);
  REQUIRE(std::ranges::count(order, '1') == 10);
  REQUIRE(std::ranges::count(order, '2') == 10);
  REQUIRE(std::ranges::count(order, '3') == 20);
  REQUIRE(std::ranges::count(order, '4') == 20);
}

TEST_CASE("A session does not pay for the last one that had its number") {
  WorkQueue queue(1);
  Cost cost(100);
  QueuedWork last = Work(1, WorkKind::kQuery, 1, cost);
  queue.Push(&last);
  queue.Settle(*queue.TryTakeBite(), 400'000);
  queue.Forget(1);
  QueuedWork query = Work(1, WorkKind::kQuery, 3, cost);
  QueuedWork other = Work(2, WorkKind::kQuery, 3, cost);
  queue.Push(&query);
  queue.Push(&other);
  REQUIRE(Order(queue, 6) == "121212");
}

TEST_CASE("A step is next however many queries came before it") {
  WorkQueue queue(1);
  Cost cost(100);
  QueuedWork query = Work(1, WorkKind::kQuery, 100, cost);
  QueuedWork other_query = Work(2, WorkKind::kQuery, 100, cost);
  queue.Push(&query);
  queue.Push(&other_query);
  REQUIRE(Order(queue, 7) == "1212121");
  QueuedWork step = Work(3, WorkKind::kLanes, 1, cost);
  queue.Push(&step);
  REQUIRE(Order(queue, 3) == "321");
}

TEST_CASE("The requests of one session keep their order, and pieces cover every item once") {
  WorkQueue queue(1);
  Cost cost(50);
  QueuedWork first = Work(1, WorkKind::kQuery, 5, cost);
  QueuedWork second = Work(1, WorkKind::kQuery, 1, cost);
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
  WorkQueue queue(1);
  Cost cost(125);
  QueuedWork work = Work(1, WorkKind::kLanes, 10, cost);
  queue.Push(&work);
  std::vector<std::pair<uint32_t, uint32_t>> pieces;
  while (!queue.empty()) {
    const std::optional<Piece> piece = pieces.size() % 2 == 0 ? queue.TryTakeBite() : Take(queue);
    REQUIRE(piece);
    pieces.emplace_back(piece->first, piece->count);
  }
  REQUIRE(pieces == std::vector<std::pair<uint32_t, uint32_t>>{{0, 1}, {6, 4}, {1, 1}, {2, 4}});
}

TEST_CASE("Pieces are cut by what items cost when they are taken, not when they arrived") {
  WorkQueue queue(1);
  Cost cost(10);
  QueuedWork work = Work(1, WorkKind::kQuery, 100, cost);
  queue.Push(&work);
  REQUIRE(queue.TryTakeBite()->count == 10);
  for (int i = 0; i < 10; ++i) cost.Observe(8000);
  REQUIRE(Take(queue)->count == 1);
}

TEST_CASE("Work whose deadline passed before it began comes out whole and unexecuted") {
  WorkQueue queue(1);
  Cost cost(100);
  QueuedWork late = Work(1, WorkKind::kLanes, 5, cost);
  late.deadline = Deadline::AfterMs(0);
  queue.Push(&late);
  const std::optional<Piece> piece = queue.TryTakeBite();
  REQUIRE(piece);
  REQUIRE(piece->expired);
  REQUIRE(piece->count == 5);
  REQUIRE(queue.empty());
}

TEST_CASE("A deadline ends work that waits behind others, and whoever asks in time gets nothing") {
  WorkQueue queue(1);
  Cost cost(100);
  QueuedWork first = Work(1, WorkKind::kQuery, 2, cost);
  QueuedWork second = Work(1, WorkKind::kQuery, 3, cost);
  queue.Push(&first);
  queue.Push(&second);
  REQUIRE_FALSE(queue.TakeExpired(&second));
  second.deadline = Deadline::AfterMs(0);
  const std::optional<Piece> rest = queue.TakeExpired(&second);
  REQUIRE(rest);
  REQUIRE((rest->expired && rest->work == &second && rest->count == 3));
  REQUIRE_FALSE(queue.TakeExpired(&second));
  REQUIRE(Order(queue, 3) == "11-");
}

TEST_CASE("Steps that have begun are finished after their deadline, other work ends at it") {
  const bool ends_at_deadline = GENERATE(false, true);
  CAPTURE(ends_at_deadline);
  WorkQueue queue(1);
  Cost cost(100);
  QueuedWork work = Work(1, WorkKind::kLanes, 4, cost);
  work.ends_at_deadline = ends_at_deadline;
  queue.Push(&work);
  REQUIRE_FALSE(queue.TryTakeBite()->expired);
  work.deadline = Deadline::AfterMs(0);
  REQUIRE(queue.TakeExpired(&work).has_value() == ends_at_deadline);
  if (ends_at_deadline) {
    REQUIRE(queue.empty());
    return;
  }
  const std::optional<Piece> rest = queue.TryTakeBite();
  REQUIRE(rest);
  REQUIRE_FALSE(rest->expired);
  REQUIRE(rest->first == 1);
}

TEST_CASE("What a piece leaves comes next, and pieces still cover every item once") {
  WorkQueue queue(1);
  Cost cost(50);
  QueuedWork work = Work(1, WorkKind::kQuery, 20, cost);
  QueuedWork later = Work(1, WorkKind::kQuery, 1, cost);
  queue.Push(&work);
  queue.Push(&later);
  std::vector<uint32_t> firsts;
  std::vector<int> times(work.items);
  while (std::ranges::count(times, 1) < 20) {
    const std::optional<Piece> piece = firsts.size() % 2 == 0 ? Take(queue) : queue.TryTakeBite();
    REQUIRE(piece);
    REQUIRE(piece->work == &work);
    queue.Settle(*piece, 50);
    const uint32_t done = firsts.size() < 3 ? 1 : piece->count;
    firsts.push_back(piece->first);
    for (uint32_t item = 0; item < done; ++item) ++times[piece->first + item];
    if (done < piece->count) queue.PutBack(*piece, done);
  }
  // 10 to 19, of which 11 to 19 were left, of whose bite 12 was.
  firsts.resize(3);
  REQUIRE(firsts == std::vector<uint32_t>{10, 11, 12});
  REQUIRE(std::ranges::max(times) == 1);
  REQUIRE(queue.TryTakeBite()->work == &later);
}

TEST_CASE("Work of which no item was left waits again once some are put back, in its old place") {
  WorkQueue queue(1);
  Cost cost(50);
  QueuedWork first = Work(1, WorkKind::kLanes, 2, cost);
  QueuedWork second = Work(1, WorkKind::kLanes, 2, cost);
  QueuedWork third = Work(1, WorkKind::kLanes, 2, cost);
  for (QueuedWork* work : {&first, &second, &third}) queue.Push(work);
  const std::optional<Piece> of_first = queue.TryTakeBite();
  const std::optional<Piece> of_second = queue.TryTakeBite();
  queue.PutBack(*of_first, 1);
  queue.PutBack(*of_second, 1);
  std::vector<QueuedWork*> order;
  while (const std::optional<Piece> piece = queue.TryTakeBite()) {
    REQUIRE(piece->count == (piece->work == &third ? 2 : 1));
    order.push_back(piece->work);
  }
  REQUIRE(order == std::vector<QueuedWork*>{&first, &second, &third});
  queue.PutBack({&third, 0, 2}, 1);
  REQUIRE_FALSE(queue.empty());
  REQUIRE(queue.TryTakeBite()->first == 1);
  REQUIRE(queue.empty());
}

TEST_CASE("A session pays for what was used of a piece, whatever of it was put back") {
  WorkQueue queue(1);
  Cost cost(50);
  QueuedWork dear = Work(1, WorkKind::kQuery, 100, cost);
  QueuedWork other = Work(2, WorkKind::kQuery, 100, cost);
  queue.Push(&dear);
  queue.Push(&other);
  const std::optional<Piece> piece = queue.TryTakeBite();  // of 0.1 ms
  REQUIRE(piece->work == &dear);
  queue.Settle(*piece, 550);
  queue.PutBack(*piece, 1);
  REQUIRE(Order(queue, 6) == "222222");
  REQUIRE(queue.TryTakeBite()->first == 1);  // what was put back, which is half a bite
}

TEST_CASE("A deadline ends the items that were put back with all others") {
  WorkQueue queue(1);
  Cost cost(50);
  QueuedWork work = Work(1, WorkKind::kQuery, 10, cost);
  work.ends_at_deadline = true;
  queue.Push(&work);
  const std::optional<Piece> piece = queue.TryTakeBite();
  const std::optional<Piece> other = queue.TryTakeBite();
  REQUIRE((piece->count == 2 && other->count == 2));
  queue.PutBack(*piece, 1);
  REQUIRE_FALSE(queue.TakeExpired(&work));
  work.deadline = Deadline::AfterMs(0);
  const std::optional<Piece> rest = queue.TakeExpired(&work);
  REQUIRE(rest);
  REQUIRE((rest->expired && rest->count == 7));
  REQUIRE(queue.empty());
  queue.PutBack(*other, 1);
  REQUIRE(queue.TakeExpired(&work)->count == 1);
  REQUIRE(queue.empty());
}

TEST_CASE("Many threads take every item exactly once, and Stop ends all waits") {
  const auto spin = std::chrono::microseconds(GENERATE(0, 100, 10'000));
  constexpr uint32_t kJobs = 200;
  constexpr uint32_t kItems = 70;
  WorkQueue queue(4);
  Cost cost(20);
  std::vector<std::unique_ptr<QueuedWork>> jobs(kJobs);
  std::vector<std::atomic<uint32_t>> taken(kJobs * kItems);
  std::atomic<uint32_t> items{0};
  std::vector<std::thread> threads;
  const auto take = [&](const Piece& piece, uint32_t count) {
    const auto job = std::ranges::find(jobs, piece.work, &std::unique_ptr<QueuedWork>::get);
    const auto first = static_cast<uint32_t>(job - jobs.begin()) * kItems + piece.first;
    for (uint32_t i = 0; i < count; ++i) taken[first + i] += 1;
    items += count;
  };
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([&] {
      Spinner spinner(spin);
      while (const std::optional<Piece> piece = queue.Take(spinner)) {
        queue.Settle(*piece, 20);
        take(*piece, 1);
        if (piece->count > 1) queue.PutBack(*piece, 1);
      }
    });
  }
  threads.emplace_back([&] {
    while (const std::optional<Piece> piece = queue.TakeInstead()) take(*piece, piece->count);
  });
  for (uint32_t i = 0; i < kJobs; ++i) {
    jobs[i] = std::make_unique<QueuedWork>(Work(i % 5, WorkKind::kQuery, kItems, cost));
  }
  for (const auto& job : jobs) queue.Push(job.get());
  const Deadline patience = Deadline::AfterMs(30'000);
  while (items < kJobs * kItems && !patience.expired()) std::this_thread::yield();
  queue.Stop();
  for (std::thread& thread : threads) thread.join();
  REQUIRE(items == kJobs * kItems);
  CHECK(std::ranges::all_of(taken, [](const auto& times) { return times == 1; }));
}

}  // namespace
}  // namespace b4mrl
