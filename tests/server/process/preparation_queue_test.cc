#include "server/process/preparation_queue.h"

#include <catch2/catch.hpp>
#include <functional>
#include <map>
#include <thread>

namespace b4mrl {
namespace {

constexpr int64_t kPatienceMs = 60'000;

// Jobs that run until they are told to end or cancelled.
class Fixture {
 public:
  explicit Fixture(int64_t short_ms = kPatienceMs, size_t of_client = 3 + 1)
      : queue({.short_places = 2, .long_places = 1, .places_of_client = of_client}, short_ms) {}

  void Submit(const std::string& key, const RoutingId& client, uint64_t bytes = 1) {
    Job* job = &jobs_[key];
    const auto work = [job](const std::atomic<bool>& cancelled) -> Result<int> {
      ++job->starts;
      while (!job->may_end && !cancelled) std::this_thread::yield();
      if (cancelled) return Status(StatusCode::kUnavailable, "cancelled");
      return 1;
    };
    const auto done = [job](const auto& result) {
      ++job->answers;
      job->code = result.status().code();
    };
    queue.Submit(key, bytes, work, {client, [job] { return job->waits; }, done});
  }
  // All requests for it expire.
  void Expire(const std::string& key) { jobs_[key].waits = false; }
  void End(const std::string& key) {
    jobs_[key].may_end = true;
    REQUIRE(Await([&] { return jobs_[key].answers > 0; }));
  }
  // Runs the queue until it holds; false if it does not in time.
  bool Await(const std::function<bool()>& holds) {
    const Deadline deadline = Deadline::AfterMs(kPatienceMs);
    while (!holds()) {
      if (deadline.expired()) return false;
      queue.Run();
      std::this_thread::yield();
    }
    return true;
  }
  int starts(const std::string& key) { return jobs_[key].starts; }
  int answers(const std::string& key) { return jobs_[key].answers; }
  StatusCode code(const std::string& key) { return jobs_[key].code; }

 private:
  struct Job {
    std::atomic<int> starts{0};
    std::atomic<bool> may_end{false};
    bool waits = true;
    int answers = 0;
    StatusCode code = StatusCode::kInternal;
  };
  std::map<std::string, Job> jobs_;

 public:
  PreparationQueue<int> queue;
};

TEST_CASE("requests for one thing share a job, and all are answered") {
  Fixture fixture;
  fixture.Submit("a", "first");
  fixture.Submit("a", "second");
  CHECK(fixture.queue.Backlog() == 2);
  fixture.End("a");
  CHECK(fixture.starts("a") == 1);
  CHECK(fixture.answers("a") == 2);
  CHECK(fixture.code("a") == StatusCode::kOk);
  CHECK(fixture.queue.Backlog() == 0);
  fixture.Submit("a", "first");
  CHECK(fixture.Await([&] { return fixture.starts("a") == 2; }));
}

TEST_CASE("clients with nothing running go first, then small jobs, then old ones") {
  Fixture fixture;
  fixture.Submit("1", "greedy", 1);
  fixture.Submit("2", "greedy", 2);
  REQUIRE(fixture.Await([&] { return fixture.starts("1") + fixture.starts("2") == 2; }));
  fixture.Submit("tiny", "greedy", 1);
  fixture.Submit("large", "modest", 1000);
  fixture.Submit("small", "modest", 10);
  fixture.Submit("late", "modest", 10);
  for (const auto& [ended, started] : {std::pair{"1", "small"}, std::pair{"2", "tiny"},
                                       std::pair{"tiny", "late"}, std::pair{"late", "large"}}) {
    CAPTURE(started);
    CHECK(fixture.starts(started) == 0);
    fixture.End(ended);
    CHECK(fixture.Await([&] { return fixture.starts(started) == 1; }));
  }
}

TEST_CASE("a large job starts in the end, though smaller ones of others keep coming") {
  Fixture fixture;
  fixture.Submit("1", "first");
  fixture.Submit("2", "second");
  REQUIRE(fixture.Await([&] { return fixture.starts("1") + fixture.starts("2") == 2; }));
  fixture.Submit("large", "third", 1000);
  fixture.Submit("small", "fourth");
  fixture.End("1");
  REQUIRE(fixture.Await([&] { return fixture.starts("small") == 1; }));
  CHECK(fixture.starts("large") == 0);
  fixture.Submit("as small", "fifth");
  fixture.End("2");
  // The fourth start is the oldest job's.
  CHECK(fixture.Await([&] { return fixture.starts("large") + fixture.starts("as small") == 1; }));
  CHECK(fixture.starts("large") == 1);
}

TEST_CASE("the jobs of one client take no more places than it may have") {
  Fixture fixture(/*short_ms=*/20, /*of_client=*/1);
  for (const char* key : {"1", "2", "3"}) fixture.Submit(key, "greedy");
  fixture.Submit("other", "modest");
  REQUIRE(fixture.Await([&] { return fixture.starts("1") + fixture.starts("other") == 2; }));
  fixture.End("other");
  CHECK(fixture.starts("2") + fixture.starts("3") == 0);
  fixture.End("1");
  CHECK(fixture.starts("1") == 1);  // it made way for none that may not start
  CHECK(fixture.Await([&] { return fixture.starts("2") == 1; }));
  CHECK(fixture.starts("3") == 0);
}

TEST_CASE("a job that nobody waits for any more is dropped before it starts") {
  Fixture fixture;
  for (const char* key : {"1", "2"}) fixture.Submit(key, "greedy");
  REQUIRE(fixture.Await([&] { return fixture.starts("1") + fixture.starts("2") == 2; }));
  fixture.Submit("expired", "greedy");
  fixture.Submit("late", "modest", 1000);
  CHECK(fixture.queue.BacklogOf("greedy") == 3);
  CHECK(fixture.queue.BacklogOf("modest") == 1);
  fixture.Expire("expired");
  fixture.queue.Run();
  CHECK(fixture.queue.BacklogOf("greedy") == 2);
  for (const char* key : {"1", "2", "late"}) fixture.End(key);
  fixture.queue.Run();
  CHECK(fixture.queue.Backlog() == 0);
  CHECK(fixture.starts("expired") == 0);
  CHECK(fixture.answers("expired") == 0);
}

TEST_CASE(
    "requests that need no answer any more leave a running job, but the one whose place it has") {
  Fixture fixture(kPatienceMs, /*of_client=*/1);
  for (int i = 0; i < 5; ++i) fixture.Submit("slow", "client");
  REQUIRE(fixture.Await([&] { return fixture.starts("slow") == 1; }));
  CHECK(fixture.queue.BacklogOf("client") == 5);
  fixture.Expire("slow");
  fixture.queue.Run();
  CHECK(fixture.queue.BacklogOf("client") == 1);
  fixture.Submit("next", "client");
  fixture.Submit("of another", "bystander");
  REQUIRE(fixture.Await([&] { return fixture.starts("of another") == 1; }));
  CHECK(fixture.starts("next") == 0);
  fixture.End("slow");
  CHECK(fixture.answers("slow") == 1);
  CHECK(fixture.Await([&] { return fixture.starts("next") == 1; }));
}

TEST_CASE("long jobs leave the places for short ones to those that wait, and end in their own") {
  Fixture fixture(/*short_ms=*/20);
  const std::vector<std::string> bombs = {"a", "b", "c", "d"};
  for (const std::string& key : bombs) fixture.Submit(key, "attacker");
  for (int i = 0; i < 3; ++i) {
    const std::string key = "small-" + std::to_string(i);
    fixture.Submit(key, "bystander");
    // Ends at once; it starts although the four others never end.
    fixture.End(key);
  }
  for (const std::string& key : bombs) CHECK(fixture.answers(key) == 0);
  // Whatever was cancelled is done in the end.
  for (const std::string& key : bombs) fixture.End(key);
  for (const std::string& key : bombs) CHECK(fixture.code(key) == StatusCode::kOk);
  CHECK(fixture.queue.Backlog() == 0);
}

TEST_CASE("a job that is slow for once waits for the end of no other") {
  Fixture fixture(/*short_ms=*/5);
  for (const char* key : {"a", "b", "c", "d"}) fixture.Submit(key, "attacker");
  fixture.Submit("slow", "bystander");
  // Longer than its first turn, so that it is started again, in the one place for long jobs.
  REQUIRE(fixture.Await([&] { return fixture.starts("slow") >= 2; }));
  fixture.End("slow");
  for (const char* key : {"a", "b", "c", "d"}) CHECK(fixture.answers(key) == 0);
}

TEST_CASE("a long job goes on where it is while nobody waits") {
  Fixture fixture(/*short_ms=*/1);
  for (const char* key : {"a", "b", "c"}) fixture.Submit(key, "client");
  // One becomes long, which lets the third one start; then all three places are taken.
  REQUIRE(fixture.Await(
      [&] { return fixture.starts("a") + fixture.starts("b") + fixture.starts("c") >= 3; }));
  for (const char* key : {"a", "b", "c"}) fixture.End(key);
  CHECK(fixture.starts("a") + fixture.starts("b") + fixture.starts("c") == 3);
}

TEST_CASE("the end of the queue is the end of what runs") {
  Fixture fixture;
  fixture.Submit("endless", "client");
  REQUIRE(fixture.Await([&] { return fixture.starts("endless") == 1; }));
}  // hangs if the queue only waits

TEST_CASE("who joins a job does not make its others wait") {
  Fixture fixture(/*short_ms=*/20, /*of_client=*/1);
  fixture.Submit("1", "greedy");
  REQUIRE(fixture.Await([&] { return fixture.starts("1") == 1; }));
  fixture.Submit("2", "greedy");
  fixture.Submit("2", "modest");
  CHECK(fixture.Await([&] { return fixture.starts("2") == 1; }));
}

}  // namespace
}  // namespace b4mrl
