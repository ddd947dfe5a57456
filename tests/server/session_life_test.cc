// Sessions between gateway and worker: who may end one while the other is still opening it.
#include <catch2/catch.hpp>

#include "tests/server/worker_fixture.h"

namespace b4mrl {
namespace {

// Whether every lane can be had again, once what is closed was freed.
bool AllLanesAreFree(SharedState& state) {
  SessionTable table(state);
  std::vector<uint32_t> taken;
  for (uint32_t i = 0; i < limits::kMaxLanes / limits::kMaxLanesPerSession; ++i) {
    const std::string token(limits::kTokenBytes, static_cast<char>('A' + i));
    const Result<uint32_t> index =
        table.Allocate({token, "request", 1, limits::kMaxLanesPerSession});
    if (index.ok()) taken.push_back(*index);
  }
  for (const uint32_t index : taken) table.Free(index);
  return taken.size() == limits::kMaxLanes / limits::kMaxLanesPerSession;
}

TEST_CASE("A session closed before the gateway has acknowledged it stays closed, and frees all") {
  WorkerFixture worker;
  const uint32_t index = worker.Allocate(2);
  REQUIRE(worker.Attach(index) == StatusCode::kOk);
  REQUIRE(worker.Close() == StatusCode::kOk);
  REQUIRE_FALSE(SessionTable(worker.state()).MakeLive(index));
  REQUIRE(worker.state().session(index).state() == SessionState::kClosed);
  REQUIRE(AllLanesAreFree(worker.state()));
}

TEST_CASE("A session closed before its Attach arrives is never built") {
  WorkerFixture worker;
  const uint32_t index = worker.Allocate(2);
  REQUIRE(worker.Close() == StatusCode::kOk);
  REQUIRE(worker.Attach(index) == StatusCode::kSessionLost);
  REQUIRE(worker.dispatcher().session_count() == 0);
  REQUIRE(AllLanesAreFree(worker.state()));
}

TEST_CASE("A Close that is late by one session does not touch the record's next one") {
  WorkerFixture worker;
  const uint32_t index = worker.Allocate(2);
  SessionRecord& record = worker.state().session(index);
  const uint64_t earlier = record.generation;
  SessionTable(worker.state()).Free(index);
  REQUIRE(worker.Open(2, "another token...") == index);
  record.Close(earlier);
  REQUIRE(record.state() == SessionState::kLive);
}

TEST_CASE("A Close reaches a session of the token that was opened again meanwhile") {
  WorkerFixture worker;
  const uint32_t first = worker.Allocate(1);
  REQUIRE(worker.Attach(first) == StatusCode::kOk);
  SessionTable(worker.state()).Free(first);
  const uint32_t second = worker.Allocate(1);
  REQUIRE(worker.Close() == StatusCode::kOk);
  REQUIRE(worker.state().session(second).state() == SessionState::kClosed);
}

TEST_CASE("The lease of a session that was never acknowledged runs out as well") {
  WorkerFixture worker;
  const uint32_t index = worker.Allocate(2);
  REQUIRE(worker.Attach(index) == StatusCode::kOk);
  worker.state().session(index).last_activity_ms -= limits::kLoopbackLeaseMs + 1;
  worker.dispatcher().ReapIdleSessions();
  REQUIRE_FALSE(SessionTable(worker.state()).MakeLive(index));
  REQUIRE(AllLanesAreFree(worker.state()));
}

}  // namespace
}  // namespace b4mrl
