#include "server/shared_state.h"

#include <unistd.h>
#include <catch2/catch.hpp>
#include <cstring>
#include <string>

#include "server/child_process.h"
#include "server/session_table.h"

namespace b4mrl {
namespace {

SharedState NewState(uint32_t workers = 2) {
  Result<SharedState> state = SharedState::Create(workers, 1000);
  REQUIRE(state.ok());
  return std::move(*state);
}

std::string Token(int number) {
  std::string token(limits::kTokenBytes, 't');
  std::memcpy(token.data(), &number, sizeof(number));
  return token;
}

Result<uint32_t> Allocate(SessionTable& table, int number, uint32_t lanes) {
  const std::string token = Token(number);
  return table.Allocate({token, "request", 1, lanes});
}

TEST_CASE("Two mappings of one state see the same memory, and other files are refused") {
  const SharedState state = NewState();
  const Result<SharedState> second = SharedState::Map(dup(state.fd()));
  REQUIRE(second.ok());
  state.child(0).steps.store(42);
  REQUIRE(second->child(0).steps == 42);
  REQUIRE(second->worker_count() == 2);
  int pipe_ends[2];
  REQUIRE(pipe(pipe_ends) == 0);
  REQUIRE_FALSE(SharedState::Map(pipe_ends[0]).ok());
  state.header().version += 1;
  REQUIRE(SharedState::Map(dup(state.fd())).status().code() == StatusCode::kVersionMismatch);
}

TEST_CASE("A session's record tells damage from truth") {
  SharedState state = NewState();
  SessionTable table(state);
  SessionRecord& record = state.session(*Allocate(table, 1, 4));
  REQUIRE(CheckSessionRecord(record).ok());
  REQUIRE(SessionToken(record) == Token(1));
  REQUIRE(SessionOpenBytes(record) == "request");
  SECTION("its bytes") { record.open[3] ^= std::byte{1}; }
  SECTION("its token") { record.token[0] ^= 1; }
  SECTION("its lanes") { record.first_lane += 1; }
  SECTION("its size") { record.open_size = UINT32_MAX; }
  SECTION("lanes beyond the end") { record.lane_count.store(UINT32_MAX); }
  REQUIRE(CheckSessionRecord(record).code() == StatusCode::kDataLoss);
}

TEST_CASE("Sessions go to the least loaded worker and never share lanes") {
  SharedState state = NewState();
  SessionTable table(state);
  const uint32_t first = *Allocate(table, 1, 10);
  const uint32_t second = *Allocate(table, 2, 4);
  const uint32_t third = *Allocate(table, 3, 4);
  REQUIRE(state.session(first).worker == 0);
  REQUIRE(state.session(second).worker == 1);
  REQUIRE(state.session(third).worker == 1);
  REQUIRE(state.session(first).first_lane == 0);
  REQUIRE(state.session(second).first_lane == 10);
  REQUIRE(state.session(third).first_lane == 14);
  SECTION("a gap is used again once its session is closed") {
    state.session(second).Close(state.session(second).generation);
    REQUIRE(state.session(*Allocate(table, 4, 5)).first_lane == 18);
    REQUIRE(state.session(*Allocate(table, 5, 4)).first_lane == 10);
  }
  SECTION("tokens are found while the session is open") {
    REQUIRE(table.Find(Token(2)) == second);
    table.MakeLive(second);
    REQUIRE(table.Find(Token(2)) == second);
    state.session(second).Close(state.session(second).generation);
    REQUIRE_FALSE(table.Find(Token(2)));
    REQUIRE_FALSE(table.MakeLive(second));  // a late acknowledgement does not revive it
    REQUIRE_FALSE(table.Find(Token(2)));
  }
}

TEST_CASE("Sessions and lanes are limited, each with its own message") {
  SharedState state = NewState();
  SessionTable table(state);
  for (uint32_t i = 0; i < limits::kMaxLanes / limits::kMaxLanesPerSession; ++i) {
    REQUIRE(Allocate(table, static_cast<int>(i), limits::kMaxLanesPerSession).ok());
  }
  REQUIRE(Allocate(table, 5000, 1).status().code() == StatusCode::kLimitExceeded);
  for (uint32_t i = 8; i < limits::kMaxSessions; ++i) {
    REQUIRE(Allocate(table, static_cast<int>(i), 0).ok());
  }
  const Status full = Allocate(table, 6000, 0).status();
  REQUIRE(full.code() == StatusCode::kLimitExceeded);
  REQUIRE(full.message().find("sessions") != std::string::npos);
}

TEST_CASE("Openings that nobody asks about any more are taken back") {
  SharedState state = NewState();
  SessionTable table(state);
  const uint32_t index = *Allocate(table, 1, 4);
  table.Reap(60'000);
  REQUIRE(table.Find(Token(1)) == index);
  state.session(index).last_activity_ms -= 60'001;
  table.Reap(60'000);
  REQUIRE_FALSE(table.Find(Token(1)));
}

const uint64_t kStep = AttemptKey(Operation::kStep);

// Puts lane `lane` into slot number 0 and marks thread `thread` of worker 0 as executing its
// operation 1.
void MarkLane(SharedState& state, uint32_t thread, uint32_t lane, int64_t since_ms) {
  state.lane(lane).Initialize(1, 8);
  ThreadMark& mark = state.marks(0)[thread];
  mark.lane.store(lane);
  mark.number.store(1);
  mark.attempt.store(kStep);
  mark.since_ms.store(since_ms);
  mark.kind.store(MarkKind::kLane);
}

TEST_CASE("The thread that raised the deadly signal takes all the blame") {
  SharedState state = NewState();
  for (int death = 0; death < 2; ++death) {
    ThreadMark& guilty = state.marks(0)[1];
    guilty.lane.store(3);
    guilty.number.store(1);
    guilty.attempt.store(kStep);
    guilty.kind.store(MarkKind::kLane);
    guilty.crashed.store(1);
    ThreadMark& bystander = state.marks(0)[2];
    bystander.lane.store(4);
    bystander.number.store(1);
    bystander.attempt.store(kStep);
    bystander.kind.store(MarkKind::kLane);
    BlameDeath(state, 0, Death::kCrashed);
    REQUIRE(guilty.kind == MarkKind::kIdle);
  }
  REQUIRE(state.lane(3).condemned(kStep));
  REQUIRE_FALSE(state.lane(4).condemned(kStep));
}

TEST_CASE("Of a frozen process only what had stood for long is blamed") {
  SharedState state = NewState();
  const int64_t now = MonotonicMs();
  MarkLane(state, 1, 3, now - limits::kFrozenChildMs);
  MarkLane(state, 2, 4, now);
  BlameDeath(state, 0, Death::kFrozen);
  state.lane(3).AddBlame(1, kStep, kCrashBlame);
  state.lane(4).AddBlame(1, kStep, kCrashBlame);
  REQUIRE(state.lane(3).condemned(kStep));
  REQUIRE_FALSE(state.lane(4).condemned(kStep));
}

// Marks threads first..last - 1 of worker 0 as executing rows of a query of session 2.
void MarkQuery(SharedState& state, uint32_t first, uint32_t last, uint64_t request_id) {
  for (uint32_t thread = first; thread < last; ++thread) {
    ThreadMark& mark = state.marks(0)[thread];
    mark.session.store(2);
    mark.number.store(request_id);
    mark.since_ms.store(0);
    mark.kind.store(MarkKind::kQuery);
  }
}

TEST_CASE("A query on many threads takes the blame of one death once") {
  SharedState state = NewState();
  MarkQuery(state, 0, 16, 77);
  BlameDeath(state, 0, Death::kKilled);
  MarkQuery(state, 0, 16, 77);
  BlameDeath(state, 0, Death::kFrozen);
  REQUIRE_FALSE(IsQueryCondemned(state.session(2), 77));
  MarkQuery(state, 0, 16, 77);
  BlameDeath(state, 0, Death::kFrozen);
  REQUIRE(IsQueryCondemned(state.session(2), 77));
  REQUIRE_FALSE(IsQueryCondemned(state.session(2), 78));
}

TEST_CASE("Several queries of a session are blamed side by side") {
  SharedState state = NewState();
  for (int death = 0; death < 2; ++death) {
    MarkQuery(state, 0, 2, 77);
    MarkQuery(state, 2, 4, 78);
    BlameDeath(state, 0, Death::kFrozen);
  }
  REQUIRE(IsQueryCondemned(state.session(2), 77));
  REQUIRE(IsQueryCondemned(state.session(2), 78));
}

TEST_CASE("Marks that a wild pointer has overwritten harm nobody") {
  SharedState state = NewState();
  for (ThreadMark& mark : state.marks(0)) {
    mark.kind.store(MarkKind::kLane);
    mark.lane.store(UINT32_MAX);
    mark.session.store(UINT32_MAX);
  }
  state.marks(0)[0].kind.store(MarkKind::kQuery);
  state.marks(0)[1].kind.store(static_cast<MarkKind>(77));
  BlameDeath(state, 0, Death::kCrashed);
  REQUIRE(state.marks(0)[1].kind == MarkKind::kIdle);
}

}  // namespace
}  // namespace b4mrl
