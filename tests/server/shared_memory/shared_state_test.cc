#include "server/shared_memory/shared_state.h"

#include <unistd.h>
#include <catch2/catch.hpp>
#include <cstring>
#include <string>

#include "server/shared_memory/session_table.h"

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

TEST_CASE("A session goes to no worker that is down while another one runs") {
  SharedState state = NewState();
  SessionTable table(state);
  state.child(kFirstWorkerChild + 1).process_id = 1;
  for (uint64_t token = 1; token <= 3; ++token) {
    CHECK(state.session(*Allocate(table, token, 4)).worker == 1);
  }
  state.child(kFirstWorkerChild).process_id = 1;  // it is back
  CHECK(state.session(*Allocate(table, 4, 4)).worker == 0);
}

TEST_CASE("Sessions without lanes are spread over the workers as well") {
  SharedState state = NewState();
  SessionTable table(state);
  const uint32_t first = *Allocate(table, 1, 0);
  const uint32_t second = *Allocate(table, 2, 0);
  REQUIRE(state.session(first).worker == 0);
  REQUIRE(state.session(second).worker == 1);
}

TEST_CASE("A session without lanes weighs as much as a lane") {
  SharedState state = NewState();
  SessionTable table(state);
  REQUIRE(state.session(*Allocate(table, 1, 2)).worker == 0);
  REQUIRE(state.session(*Allocate(table, 2, 0)).worker == 1);
  REQUIRE(state.session(*Allocate(table, 3, 0)).worker == 1);
  CHECK(state.session(*Allocate(table, 4, 0)).worker == 0);
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

}  // namespace
}  // namespace b4mrl
