// Who is to blame when an environment worker dies, and what is not tried again.
//
// Every thread of a worker marks in shared memory what it executes. The handler of deadly signals
// records the thread that raised one, the supervisor the thread that stands still. When the process
// has died, the supervisor gives points to what the guilty threads had marked: to a lane's
// operation (kept in lane_slot.h), a request or the building of a session (kept in shared_state.h).
// The replacement refuses what has too many points. A kill from outside gives few points to
// operations and requests, which need not have caused it, and none to the building of a session,
// which every replacement begins with. Neither does a crash in a thread that executes nothing of a
// session, such as ZeroMQ's own, give more than a kill. Waiting for a processor gives no points.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>

#include "server/shared_memory/shared_state.h"

namespace b4mrl {

// How a process ended.
enum class Death {
  kKilled,   // SIGKILL from outside the daemon, or from the supervisor for the process's memory
  kCrashed,  // another signal, or an exit without a drain
  kFrozen,   // SIGKILL from the supervisor, because the process stood still
};

// Points for a crash or freeze, and for a kill from outside. An operation or request is refused
// from kBlameLimit points on: after two crashes or eight kills.
inline constexpr uint32_t kCrashBlame = 4;
inline constexpr uint32_t kKillBlame = 1;
inline constexpr uint32_t kBlameLimit = 8;
// A session is refused when its building has ended this many workers in a row.
inline constexpr uint32_t kMaxBuildDeaths = 3;

// Blame is kept for a lane, a number and an attempt. The attempt is the operation and a reset's
// seed, as a reset with another seed may work.
uint64_t AttemptKey(Operation operation, std::optional<uint64_t> seed = std::nullopt);

// Whether the lane's next operation is refused in this attempt. A refused step is replaced by the
// truncation of its episode.
bool OperationIsRefused(const LaneSlot& slot, uint64_t attempt);
// Whether the truncation in place of a refused step is refused as well.
bool TruncationIsRefused(const LaneSlot& slot, uint64_t attempt);
// Whether the request of that id is refused.
bool RequestIsRefused(const SessionRecord& record, uint64_t request_id);
// Whether the session is not built again.
bool SessionIsRefused(const SessionRecord& record);

// While it exists, says in the thread's mark what the thread executes. Marks do not nest.
class ScopedMark {
 public:
  // An operation of a lane, which is an index into SharedState::lane.
  static ScopedMark OfLane(ThreadMark* mark, uint32_t lane, uint64_t number, uint64_t attempt);
  // The examination of a request, or the execution of one that changes no lane.
  static ScopedMark OfRequest(ThreadMark* mark, uint32_t session, uint64_t request_id);
  // The building of the session whose record has this generation.
  static ScopedMark OfSession(ThreadMark* mark, uint32_t session, uint64_t generation);
  ~ScopedMark() { mark_->kind.store(MarkKind::kIdle, std::memory_order_release); }
  ScopedMark(const ScopedMark&) = delete;
  ScopedMark& operator=(const ScopedMark&) = delete;

 private:
  ScopedMark(ThreadMark* mark, MarkKind kind, uint64_t number);

  ThreadMark* mark_;
};

// While it exists, the calling thread owns `mark`: a deadly signal that the thread raises is
// recorded there, an overflow of its stack too.
class MarkedThread {
 public:
  explicit MarkedThread(ThreadMark* mark);
  ~MarkedThread();
  MarkedThread(const MarkedThread&) = delete;
  MarkedThread& operator=(const MarkedThread&) = delete;

 private:
  std::unique_ptr<std::byte[]> signal_stack_;
};

// Makes every deadly signal of this process record the thread that raised it, in its mark or, where
// it has none, in the process's `record`, which stays mapped; and then act as before.
void InstallCrashRecorder(ChildRecord& record);

// Supervisor: gives points for the death of environment worker `worker` to what its threads were
// executing, and clears their marks. Where threads are known to be guilty, they alone are blamed;
// where one without a mark crashed alone, the death counts as a kill from outside.
void BlameDeath(SharedState& shared, uint32_t worker, Death death);

}  // namespace b4mrl
