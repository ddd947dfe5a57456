// Sessions between gateway and worker: who may end one while the other is still opening it, and who
// takes over what a dead worker has left.
#include <algorithm>
#include <catch2/catch.hpp>

#include "server/process/child.h"
#include "server/worker/fault_point.h"
#include "tests/server/worker/worker_fixture.h"

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

TEST_CASE("A Close is answered at its deadline, and happens all the same") {
  WorkerFixture worker;
  const uint32_t index = worker.Open(1);
  worker.Reset({1});
  worker.answers.clear();
  worker.Send(WorkerFixture::StepRequest(), {Numbers({2}), Actions(1, 0)}, /*waiting=*/true);
  pb::Request close;
  close.mutable_close();
  close.set_request_id(7);
  close.set_deadline_ms(1);
  worker.Send(close, {});
  worker.AwaitDeadline();
  REQUIRE(worker.answers.size() == 1);
  CHECK(worker.answers[0].envelope.request_id() == 7);
  CHECK(worker.answers[0].code() == StatusCode::kDeadlineExceeded);
  worker.Send(WorkerFixture::StepRequest(), {Numbers({3}), Actions(1, 0)});
  CHECK(worker.answers.back().code() == StatusCode::kSessionLost);
  CHECK(worker.state().session(index).state() == SessionState::kLive);
  worker.Work();
  REQUIRE(worker.answers.size() == 3);
  CHECK(worker.answers[2].code() == StatusCode::kOk);  // the step
  CHECK(worker.state().session(index).state() == SessionState::kClosed);
  CHECK(worker.Close() == StatusCode::kOk);
}

TEST_CASE("A Close that waits for what is under way outlives its worker") {
  WorkerFixture worker;
  const uint32_t index = worker.Open(1);
  worker.Reset({1});
  worker.Send(WorkerFixture::StepRequest(), {Numbers({2}), Actions(1, 0)}, /*waiting=*/true);
  pb::Request close;
  close.mutable_close();
  worker.Send(close, {});
  REQUIRE(worker.state().session(index).state() == SessionState::kLive);
  worker.Restart();
  CHECK(worker.state().session(index).state() == SessionState::kClosed);
  CHECK(worker.dispatcher().session_count() == 0);
  // The record's next session is none that was asked to close.
  SessionTable(worker.state()).Free(index);
  REQUIRE(worker.Open(1) == index);
  worker.Restart();
  CHECK(worker.dispatcher().session_count() == 1);
}

TEST_CASE("A Close that is sent again while it waits is answered once, to its newest sender") {
  WorkerFixture worker;
  worker.Open(1);
  worker.Reset({1});
  worker.answers.clear();
  worker.Send(WorkerFixture::StepRequest(), {Numbers({2}), Actions(1, 0)}, /*waiting=*/true);
  const auto send_close = [&](uint64_t id, uint32_t deadline_ms, const RoutingId& sender) {
    pb::Request close;
    close.mutable_close();
    close.set_request_id(id);
    close.set_deadline_ms(deadline_ms);
    worker.Send(close, {}, false, sender);
  };
  send_close(7, 1, "old connection");
  send_close(8, 100'000, "another client");
  send_close(7, 100'000, "new connection");
  const bool is_late = GENERATE(false, true);
  if (is_late) send_close(7, 1, "newest connection");
  if (is_late) worker.AwaitDeadline();
  worker.Work();
  REQUIRE(worker.answers.size() == 3);
  const auto answer_to = [&](uint64_t id) {
    const auto found = std::ranges::find_if(
        worker.answers, [id](const Answer& a) { return a.envelope.request_id() == id; });
    REQUIRE(found != worker.answers.end());
    return *found;
  };
  CHECK(answer_to(7).receiver == (is_late ? "newest connection" : "new connection"));
  CHECK(answer_to(7).code() == (is_late ? StatusCode::kDeadlineExceeded : StatusCode::kOk));
  CHECK(answer_to(8).receiver == "another client");
  CHECK(answer_to(8).code() == StatusCode::kOk);
}

// That sessions of this task may come to take in a worker with one thread, and so the stand-in.
uint64_t SimulatorBytes(const std::string& environment) {
  const Result<std::shared_ptr<const Simulator>> simulator =
      Simulator::Open({.environment = environment, .perturbations = {}, .config = ""});
  REQUIRE(simulator.ok());
  return (*simulator)->memory_bytes(2);
}

TEST_CASE("Sessions may together have the simulators for which the worker has memory") {
  WorkerFixture worker;
  const std::string cheetah(limits::kTokenBytes, 'c'), hopper(limits::kTokenBytes, 'h');
  worker.memory.simulators = std::max(SimulatorBytes("HalfCheetah"), SimulatorBytes("Hopper"));
  worker.Restart();
  worker.Open(1, cheetah);
  worker.Open(3);  // of the same simulator, which takes no more memory
  CHECK(worker.Attach(worker.Allocate(1, hopper, "Hopper")) == StatusCode::kLimitExceeded);
  CHECK(worker.answers.back().envelope.status().recoverable());
  CHECK(worker.dispatcher().session_count() == 2);

  worker.Restart();
  CHECK(worker.dispatcher().session_count() == 2);
  CHECK(worker.Close(cheetah) == StatusCode::kOk);
  CHECK(worker.Close() == StatusCode::kOk);
  worker.Open(1, std::string(limits::kTokenBytes, 'n'), "Hopper");
}

TEST_CASE("A simulator that needs more memory than any worker has is refused for good") {
  WorkerFixture worker;
  worker.memory.simulators = SimulatorBytes("HalfCheetah") - 1;
  worker.Restart();
  CHECK(worker.Attach(worker.Allocate(1)) == StatusCode::kInvalidArgument);
  CHECK_FALSE(worker.answers.back().envelope.status().recoverable());
  CHECK(worker.dispatcher().session_count() == 0);
}

TEST_CASE("A session whose last lane would get a seed beyond 64 bits is refused") {
  WorkerFixture worker;
  worker.open.set_seed(UINT64_MAX - 1);
  CHECK(worker.Attach(worker.Allocate(3)) == StatusCode::kInvalidArgument);
  CHECK(worker.answers.back().envelope.status().message() ==
        "seed is '18446744073709551614', allowed: 0..18446744073709551613 with 3 lanes");
  worker.Open(2, "another token...");
  worker.open.set_seed(UINT64_MAX);
  worker.Open(0, "a third token...");
}

TEST_CASE("Live sessions come before opening ones where a replacement has memory for some") {
  WorkerFixture worker;
  const std::string hopper(limits::kTokenBytes, 'h');
  const uint32_t opening = worker.Allocate(1);  // with the lower index, and never attached
  const uint32_t live = worker.Open(1, hopper, "Hopper");
  REQUIRE(opening < live);
  worker.memory.simulators = SimulatorBytes("HalfCheetah");  // the live one takes it
  worker.Restart();
  CHECK(worker.dispatcher().session_count() == 1);
  CHECK(worker.state().session(live).state() == SessionState::kLive);
  CHECK(worker.Attach(opening) == StatusCode::kLimitExceeded);
}

TEST_CASE("A session whose worker dies between its reply and the acknowledgement is served") {
  WorkerFixture worker;
  const uint32_t index = worker.Allocate(2);
  REQUIRE(worker.Attach(index) == StatusCode::kOk);
  worker.Restart();
  REQUIRE(SessionTable(worker.state()).MakeLive(index));
  REQUIRE(worker.Reset({1, 1}).code() == StatusCode::kOk);
}

TEST_CASE("An opening that ended a worker is left to its next Attach, or adopted once it is live") {
  WorkerFixture worker;
  const uint32_t index = worker.Allocate(2);
  REQUIRE(worker.Attach(index) == StatusCode::kOk);
  worker.state().session(index).build_deaths.store(1);  // of a replacement
  worker.Restart();
  REQUIRE(worker.dispatcher().session_count() == 0);
  SECTION("its Attach") {
    REQUIRE(worker.Attach(index) == StatusCode::kOk);
    REQUIRE(SessionTable(worker.state()).MakeLive(index));
  }
  SECTION("the acknowledgement of the first worker's answer") {
    REQUIRE(SessionTable(worker.state()).MakeLive(index));
    worker.dispatcher().AdoptNext();
  }
  REQUIRE(worker.Reset({1, 1}).code() == StatusCode::kOk);
}

TEST_CASE("A worker that serves messages builds no session before its Attach") {
  WorkerFixture worker;
  const uint32_t index = worker.Allocate(2);
  for (uint32_t i = 0; i < limits::kMaxSessions; ++i) worker.dispatcher().AdoptNext();
  REQUIRE(worker.dispatcher().session_count() == 0);
  REQUIRE(worker.Attach(index) == StatusCode::kOk);
}

TEST_CASE("A worker that serves messages takes over one session at a time") {
  WorkerFixture worker;
  std::vector<uint32_t> opening;
  for (const char* token : {"first token.....", "second token....", "third token....."}) {
    opening.push_back(worker.Allocate(1, token));
    REQUIRE(worker.Attach(opening.back()) == StatusCode::kOk);
    worker.state().session(opening.back()).build_deaths.store(1);  // so that Restart leaves it
  }
  worker.Restart();
  for (const uint32_t index : opening) REQUIRE(SessionTable(worker.state()).MakeLive(index));
  for (size_t built = 1; built <= 3; ++built) {
    worker.dispatcher().AdoptNext();
    REQUIRE(worker.dispatcher().session_count() == built);
  }
}

TEST_CASE("What is wrong with an opening is said to its Attach, whoever looked at it before") {
  WorkerFixture worker;
  const uint32_t index = worker.Allocate(2);
  worker.state().session(index).open[3] ^= std::byte{1};
  worker.Restart();
  REQUIRE(worker.Attach(index) == StatusCode::kDataLoss);
}

TEST_CASE("An Attach without the session's token learns nothing and keeps no lease") {
  WorkerFixture worker;
  const uint32_t index = worker.Open(1);
  SessionRecord& record = worker.state().session(index);
  record.last_activity_ms.store(1);
  pb::Request attach;
  attach.set_session_token("another token...");
  attach.mutable_attach()->set_session_index(index);
  attach.mutable_attach()->set_generation(record.generation);
  const Answer answer = worker.Call(attach, {});
  REQUIRE(answer.code() == StatusCode::kSessionLost);
  REQUIRE_FALSE(answer.envelope.has_attach());
  REQUIRE(record.last_activity_ms == 1);
}

// What the gateway may do while a worker builds a session.
WorkerFixture* giving_away = nullptr;
void GiveRecordAway(FaultPoint point, uint32_t /*lane*/, uint64_t /*number*/,
                    std::span<std::byte> /*idle_buffer*/) {
  if (point != FaultPoint::kBeforeAttach) return;
  fault_hook = nullptr;
  SessionTable(giving_away->state()).Free(0);
  REQUIRE(giving_away->Allocate(2, "another token...") == 0);
}

TEST_CASE("A session whose record is given to another one while it is built is not served") {
  WorkerFixture worker;
  REQUIRE(worker.Allocate(2) == 0);
  giving_away = &worker;
  fault_hook = GiveRecordAway;
  REQUIRE(worker.Attach(0) == StatusCode::kSessionLost);
  REQUIRE(worker.dispatcher().session_count() == 0);
}

// The gateway acknowledges session 1 while the replacement builds session 0.
WorkerFixture* acknowledging = nullptr;
void AcknowledgeLate(FaultPoint point, uint32_t /*lane*/, uint64_t /*number*/,
                     std::span<std::byte> /*idle_buffer*/) {
  if (point != FaultPoint::kBeforeAttach) return;
  fault_hook = nullptr;
  REQUIRE(SessionTable(acknowledging->state()).MakeLive(1));
}

TEST_CASE("A session that becomes live while a replacement looks at the records is taken over") {
  WorkerFixture worker;
  REQUIRE(worker.Allocate(2, "another token...") == 0);
  REQUIRE(worker.Allocate(2) == 1);
  REQUIRE(worker.Attach(1) == StatusCode::kOk);
  acknowledging = &worker;
  fault_hook = AcknowledgeLate;
  worker.Restart();
  CHECK(fault_hook == nullptr);
  CHECK(worker.dispatcher().session_count() == 2);
  CHECK(worker.Reset({1, 1}).code() == StatusCode::kOk);
}

TEST_CASE("The lease of a session that was never acknowledged runs out as well") {
  WorkerFixture worker;
  const uint32_t index = worker.Allocate(2);
  REQUIRE(worker.Attach(index) == StatusCode::kOk);
  worker.state().session(index).last_activity_ms -= limits::kLoopbackLeaseMs + 1;
  worker.dispatcher().ReapIdleSessions(MonotonicMs());
  REQUIRE_FALSE(SessionTable(worker.state()).MakeLive(index));
  REQUIRE(AllLanesAreFree(worker.state()));
}

TEST_CASE("No lease runs while the worker stands still") {
  constexpr int64_t kLeaseMs = limits::kLoopbackLeaseMs;
  WorkerFixture worker;
  worker.Open(1);
  int64_t now = MonotonicMs();
  worker.dispatcher().ReapIdleSessions(now);
  now += 10 * kLeaseMs;  // the container was paused
  worker.dispatcher().ReapIdleSessions(now);
  CHECK(worker.dispatcher().session_count() == 1);
  int64_t idle = 0;
  for (; worker.dispatcher().session_count() == 1 && idle < 2 * kLeaseMs; idle += kReapIntervalMs) {
    now += kReapIntervalMs;
    worker.dispatcher().ReapIdleSessions(now);
  }
  CHECK(idle > kLeaseMs - 60'000);  // the test itself takes time
  CHECK(idle <= kLeaseMs + kReapIntervalMs);
}

}  // namespace
}  // namespace b4mrl
