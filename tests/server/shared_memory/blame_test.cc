#include "server/shared_memory/blame.h"

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <cstdlib>
#include <thread>

#include "server/shared_memory/session_table.h"

namespace b4mrl {
namespace {

SharedState NewState() {
  Result<SharedState> state = SharedState::Create(1, 1000);
  REQUIRE(state.ok());
  return std::move(*state);
}

const uint64_t kStep = AttemptKey(Operation::kStep);

// Marks thread `thread` of worker 0 as executing operation 1 of lane `lane`, which is new.
ThreadMark& MarkLane(SharedState& state, uint32_t thread, uint32_t lane) {
  state.lane(lane).Initialize(1, 8);
  ThreadMark& mark = state.marks(0)[thread];
  mark.lane.store(lane);
  mark.number.store(1);
  mark.attempt.store(kStep);
  mark.kind.store(MarkKind::kLane);
  return mark;
}

// The points that lane `lane`'s operation 1 has: so many fewer are enough to condemn it.
uint32_t PointsOf(SharedState& state, uint32_t lane) {
  uint32_t more = 0;
  for (; !OperationIsRefused(state.lane(lane), kStep); ++more)
    state.lane(lane).AddBlame(1, kStep, 1);
  return kBlameLimit - more;
}

TEST_CASE("The thread that raised the deadly signal takes all the blame") {
  SharedState state = NewState();
  ThreadMark& guilty = MarkLane(state, 1, 3);
  guilty.guilty.store(1);
  MarkLane(state, 2, 4);
  BlameDeath(state, 0, Death::kCrashed);
  REQUIRE(guilty.kind == MarkKind::kIdle);
  REQUIRE(guilty.guilty == 0);
  REQUIRE(PointsOf(state, 3) == kCrashBlame);
  REQUIRE(PointsOf(state, 4) == 0);
}

TEST_CASE("Of an exit that no thread is known for, all that was under way is blamed") {
  SharedState state = NewState();
  MarkLane(state, 1, 3);
  MarkLane(state, 2, 4);
  BlameDeath(state, 0, Death::kCrashed);
  REQUIRE(PointsOf(state, 3) == kCrashBlame);
  REQUIRE(PointsOf(state, 4) == kCrashBlame);
}

TEST_CASE("Of a frozen process only the thread that stood still by itself is blamed") {
  SharedState state = NewState();
  MarkLane(state, 1, 3).guilty.store(1);
  MarkLane(state, 2, 4).since_ms.store(0);  // for ages, but for want of a processor
  BlameDeath(state, 0, Death::kFrozen);
  REQUIRE(PointsOf(state, 3) == kCrashBlame);
  REQUIRE(PointsOf(state, 4) == 0);
}

TEST_CASE("Of a process that was stopped or starved nobody is blamed") {
  SharedState state = NewState();
  MarkLane(state, 1, 3);
  BlameDeath(state, 0, Death::kFrozen);
  REQUIRE(PointsOf(state, 3) == 0);
}

TEST_CASE("What a kill from outside interrupts takes little blame") {
  SharedState state = NewState();
  MarkLane(state, 1, 3);
  BlameDeath(state, 0, Death::kKilled);
  REQUIRE(PointsOf(state, 3) == kKillBlame);
}

// Marks threads first..last - 1 of worker 0 as executing rows of a query of session 2, and as
// guilty.
void MarkQuery(SharedState& state, uint32_t first, uint32_t last, uint64_t request_id) {
  for (uint32_t thread = first; thread < last; ++thread) {
    ThreadMark& mark = state.marks(0)[thread];
    mark.session.store(2);
    mark.number.store(request_id);
    mark.guilty.store(1);
    mark.kind.store(MarkKind::kRequest);
  }
}

TEST_CASE("A query on many threads takes the blame of one death once") {
  SharedState state = NewState();
  MarkQuery(state, 0, 16, 77);
  BlameDeath(state, 0, Death::kKilled);
  MarkQuery(state, 0, 16, 77);
  BlameDeath(state, 0, Death::kFrozen);
  REQUIRE_FALSE(RequestIsRefused(state.session(2), 77));
  MarkQuery(state, 0, 16, 77);
  BlameDeath(state, 0, Death::kFrozen);
  REQUIRE(RequestIsRefused(state.session(2), 77));
  REQUIRE_FALSE(RequestIsRefused(state.session(2), 78));
}

TEST_CASE("Several requests of a session are blamed side by side") {
  SharedState state = NewState();
  for (int death = 0; death < 2; ++death) {
    MarkQuery(state, 0, 2, 77);
    MarkQuery(state, 2, 4, 78);
    BlameDeath(state, 0, Death::kFrozen);
  }
  REQUIRE(RequestIsRefused(state.session(2), 77));
  REQUIRE(RequestIsRefused(state.session(2), 78));
}

TEST_CASE("The building of a session is blamed for a crash, and never for kills from outside") {
  SharedState state = NewState();
  SessionTable table(state);
  const uint32_t index = *table.Allocate({"token of 16 byte", "request", 1, 0});
  SessionRecord& record = state.session(index);
  const auto die = [&](Death death, uint64_t generation) {
    const ScopedMark mark = ScopedMark::OfSession(&state.marks(0)[0], index, generation);
    BlameDeath(state, 0, death);
  };
  for (int kills = 0; kills < 100; ++kills) die(Death::kKilled, record.generation);
  REQUIRE(record.build_deaths == 0);
  die(Death::kCrashed, record.generation - 1);  // an earlier session of the record
  REQUIRE(record.build_deaths == 0);
  die(Death::kCrashed, record.generation);
  REQUIRE(record.build_deaths == 1);
}

TEST_CASE("Marks that a wild pointer has overwritten harm nobody") {
  SharedState state = NewState();
  for (ThreadMark& mark : state.marks(0)) {
    mark.kind.store(MarkKind::kLane);
    mark.lane.store(UINT32_MAX);
    mark.session.store(UINT32_MAX);
  }
  state.marks(0)[0].kind.store(MarkKind::kRequest);
  state.marks(0)[1].kind.store(static_cast<MarkKind>(77));
  state.marks(0)[2].kind.store(MarkKind::kSession);
  BlameDeath(state, 0, Death::kCrashed);
  for (const ThreadMark& mark : state.marks(0)) REQUIRE(mark.kind == MarkKind::kIdle);
  for (uint32_t index = 0; index < limits::kMaxSessions; ++index) {
    const SessionRecord& record = state.session(index);
    REQUIRE(record.build_deaths == 0);
    for (const RequestBlame& entry : record.request_blames) REQUIRE(entry.blame == 0);
  }
}

// Takes more stack than there is: every call keeps its page until the one inside it has returned.
int Overflow(uint64_t depth) {
  volatile char page[4096];
  page[depth % sizeof(page)] = 1;
  return depth == UINT64_MAX ? 0 : Overflow(depth + 1) + page[0];
}

// Runs `crash` in a process of its own, the worker 0 of `state`, beside a socket's thread with mark
// 0, and waits for its end.
template <typename Crash>
void CrashInChild(SharedState& state, Crash crash) {
  const pid_t child = fork();
  if (child == 0) {
    for (const int number : {SIGSEGV, SIGABRT}) signal(number, SIG_DFL);  // not the test's report
    InstallCrashRecorder(state.child(kFirstWorkerChild));
    const MarkedThread socket_thread(&state.marks(0)[0]);
    std::thread(crash).join();
    _exit(0);
  }
  int wait_status = 0;
  REQUIRE(waitpid(child, &wait_status, 0) == child);
  REQUIRE(WIFSIGNALED(wait_status));
}

TEST_CASE("A thread that runs out of stack is recorded, and no other") {
  SharedState state = NewState();
  CrashInChild(state, [&] {
    const MarkedThread self(&state.marks(0)[1]);
    Overflow(0);
  });
  REQUIRE(state.marks(0)[1].guilty == 1);
  REQUIRE(state.marks(0)[0].guilty == 0);
  REQUIRE(state.child(kFirstWorkerChild).unmarked_crash == 0);
}

TEST_CASE("A crash in a thread that executes nothing counts as a kill for what others execute") {
  SharedState state = NewState();
  for (int crash = 0; crash < 2; ++crash) {
    MarkLane(state, 0, 3);
    CrashInChild(state, [] { abort(); });
    REQUIRE(state.marks(0)[0].guilty == 0);
    REQUIRE(state.child(kFirstWorkerChild).unmarked_crash == 1);
    BlameDeath(state, 0, Death::kCrashed);
    REQUIRE(PointsOf(state, 3) == kKillBlame);
    REQUIRE(state.child(kFirstWorkerChild).unmarked_crash == 0);
  }
}

TEST_CASE("A crash in a thread with a mark is blamed on it, whichever others crash with it") {
  SharedState state = NewState();
  MarkLane(state, 1, 3).guilty.store(1);
  MarkLane(state, 2, 4);
  state.child(kFirstWorkerChild).unmarked_crash.store(1);
  BlameDeath(state, 0, Death::kCrashed);
  REQUIRE(PointsOf(state, 3) == kCrashBlame);
  REQUIRE(PointsOf(state, 4) == 0);
}

}  // namespace
}  // namespace b4mrl
