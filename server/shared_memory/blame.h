// Who is to blame when an environment worker dies, and what is not tried again.
//
// Every thread of a worker marks what it executes in shared memory. A deadly signal records the
// thread that raised it, the supervisor one that stands still. From death and marks follow points:
// of a lane's operation (lane_slot.h), of a request, of the building of a session. At kBlameLimit
// an operation or a request is refused, after kMaxBuildDeaths a session is given up. Kills from
// outside weigh little, as nobody here need have caused them, and nothing where the work repeats
// itself at every start; time that others took weighs nothing.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include "server/shared_memory/shared_state.h"

namespace b4mrl {

// How a process ended, as far as blame and restarts care.
enum class Death {
  kKilled,   // SIGKILL from outside: nobody's fault
  kCrashed,  // another signal, or an exit that nobody asked for
  kFrozen,   // SIGKILL from the supervisor, as it stood still
};

// A session whose building ended its worker so often is given up.
inline constexpr uint32_t kMaxBuildDeaths = 3;

// Marks what a thread is doing for as long as it lives. Marks do not nest.
class ScopedMark {
 public:
  // An operation of a lane, which is an index into SharedState::lane.
  static ScopedMark OfLane(ThreadMark* mark, uint32_t lane, uint64_t number, uint64_t attempt);
  // Work for a request that changes nothing, or its examination.
  static ScopedMark OfRequest(ThreadMark* mark, uint32_t session, uint64_t request_id);
  // The building of the session that has the record in this generation.
  static ScopedMark OfSession(ThreadMark* mark, uint32_t session, uint64_t generation);
  ~ScopedMark() { mark_->kind.store(MarkKind::kIdle, std::memory_order_release); }
  ScopedMark(const ScopedMark&) = delete;
  ScopedMark& operator=(const ScopedMark&) = delete;

 private:
  ScopedMark(ThreadMark* mark, MarkKind kind, uint64_t number);

  ThreadMark* mark_;
};

// The calling thread as the owner of `mark`, while this lives: a deadly signal that it raises is
// recorded there, even one for want of stack.
class MarkedThread {
 public:
  explicit MarkedThread(ThreadMark* mark);
  ~MarkedThread();
  MarkedThread(const MarkedThread&) = delete;
  MarkedThread& operator=(const MarkedThread&) = delete;

 private:
  std::unique_ptr<std::byte[]> signal_stack_;
};

// Makes a deadly signal record which thread of this process raised it before it takes its course.
void InstallCrashRecorder();

// Supervisor: spreads the blame for the death of environment worker `worker` over what its threads
// were executing, and clears their marks. Threads that are known to be guilty take it alone.
void BlameDeath(SharedState& shared, uint32_t worker, Death death);

// Whether the request has ended its process too often to be tried again.
bool IsRequestCondemned(const SessionRecord& record, uint64_t request_id);

}  // namespace b4mrl
