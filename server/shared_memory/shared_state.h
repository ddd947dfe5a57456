// The memory that outlives every child: which children run, which sessions exist, what each lane
// last did. The supervisor creates it (an anonymous, sparse memfd) and passes its descriptor on;
// every child maps all of it.
//
//   field                               writer
//   ChildRecord: process_id, restarts   the supervisor
//     unmarked_crash                    the child; while it is dead, the supervisor
//     all others                        the child itself
//   ThreadMark                          its thread; of a worker that it kills, the supervisor
//   SessionRecord: steps,               the session's worker, while the session is opening or live
//     closing_generation, closed_generation, simulator_hash
//     last_activity_ms, build_deaths    the gateway and the session's worker
//     all others                        the gateway
//   LaneSlot                            the session's worker
//   LedgerRecord: number                the gateway
//     totals, last_use_ms               the gateway, the workers and the dataset worker
//   points of blame: in LaneSlot,       the supervisor, while the worker is dead
//     request_blames, build_deaths
//
// Numbers that several processes touch are atomics. A process checks a number that another process
// wrote before it uses the number as an index or a length: the writer may have died of a wild
// pointer.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "proto/base/limits.h"
#include "proto/base/status.h"
#include "proto/base/unique_fd.h"
#include "server/shared_memory/lane_slot.h"

namespace b4mrl {

// The gateway, the dataset worker and the environment workers, in this order in the child table.
inline constexpr uint32_t kGatewayChild = 0;
inline constexpr uint32_t kDatasetChild = 1;
inline constexpr uint32_t kFirstWorkerChild = 2;
inline constexpr uint32_t kMaxChildren = kFirstWorkerChild + limits::kMaxWorkers;
// "gateway", "dataset-worker", "worker-0" and so on.
std::string ChildName(uint32_t child);

struct alignas(64) ChildRecord {
  std::atomic<int32_t> process_id;  // 0: not running
  std::atomic<uint32_t> restarts;
  // Grows at least every 200 ms from the moment the child reads its sockets.
  std::atomic<uint64_t> heartbeat;
  // Totals since the daemon's start; they go on through restarts.
  std::atomic<uint64_t> steps;
  std::atomic<uint64_t> query_rows;
  std::atomic<uint64_t> requests;
  std::atomic<uint64_t> errors;
  // Of an environment worker. 1: a thread without a ThreadMark raised a deadly signal.
  std::atomic<uint32_t> unmarked_crash;
};

// What one thread of a worker is executing, so that a death can be blamed on it (blame.h).
enum class MarkKind : uint32_t {
  kIdle = 0,
  kLane = 1,     // an operation of a lane
  kRequest = 2,  // a request: its examination, a row of a query, a snapshot
  kSession = 3,  // the building of a session
};
struct alignas(64) ThreadMark {
  std::atomic<MarkKind> kind;      // stored last when work begins, first when it ends
  std::atomic<uint32_t> guilty;    // 1: the thread raised the deadly signal, or stood still
  std::atomic<uint32_t> lane;      // kLane: index into SharedState::lane
  std::atomic<uint32_t> session;   // kRequest, kSession: index into SharedState::session
  std::atomic<uint64_t> number;    // the operation's number, request's id or session's generation
  std::atomic<uint64_t> attempt;   // kLane: its AttemptKey
  std::atomic<int64_t> since_ms;   // MonotonicMs() when the work began
  std::atomic<int32_t> thread_id;  // the operating system's number of the thread
};
inline constexpr uint32_t kMarksPerWorker =
    limits::kMaxThreads + 1;  // the socket's thread is mark 0

enum class SessionState : uint32_t {
  kFree = 0,     // may be allocated
  kOpening = 1,  // allocated by the gateway, not yet acknowledged by the worker
  kLive = 2,     // acknowledged: its worker serves it
  kClosed = 3,   // the worker is done with it; the gateway frees it
};

// Points of blame for a request (blame.h). An entry without points is free.
struct RequestBlame {
  std::atomic<uint64_t> request_id;
  std::atomic<uint32_t> blame;
};

struct alignas(64) SessionRecord {
  std::atomic<SessionState> granted;  // by the gateway: kFree, kOpening or kLive; see state()
  std::atomic<uint32_t> worker;
  std::atomic<uint32_t> first_lane;
  std::atomic<uint32_t> lane_count;
  std::atomic<uint64_t> generation;          // never repeats; its lanes carry it too
  std::atomic<uint64_t> closing_generation;  // the last one whose Close waits for its requests
  std::atomic<uint64_t> closed_generation;   // the last generation that its worker was done with
  std::atomic<int64_t> last_activity_ms;     // MonotonicMs()
  std::atomic<uint64_t> steps;
  std::atomic<uint32_t> build_deaths;    // workers in a row that died while they built the session
  std::atomic<uint64_t> simulator_hash;  // of the simulator that wrote the lanes' records
  std::array<RequestBlame, 4> request_blames;  // of the requests with the most points
  std::array<uint8_t, limits::kTokenBytes> token;
  uint64_t request_hash;  // of the OpenRequest as it came, to compare with a second one
  // The serialised pb::OpenRequest with what the gateway adds to it, and a checksum over it, the
  // token and the lane range.
  uint64_t checksum;
  uint32_t open_size;
  std::array<std::byte, limits::kMaxOpenRecordBytes> open;

  // kClosed once the worker has closed this generation, else what the gateway granted.
  SessionState state() const;
  // Called by the session's worker, whether the gateway has acknowledged the session or not. If the
  // record belongs to another session by now, that session stays open: gateway and worker decide at
  // the same time, but neither overwrites the other's field.
  void Close(uint64_t its_generation) {
    closed_generation.store(its_generation, std::memory_order_release);
  }
};

// What a learner has used since the record got its number (ledger_table.h).
struct alignas(64) LedgerRecord {
  std::atomic<uint64_t> number;      // 0: free
  std::atomic<int64_t> last_use_ms;  // MonotonicMs() when it was last read or added to
  std::atomic<uint64_t> steps;
  std::atomic<uint64_t> episodes;
  std::atomic<uint64_t> query_rows;
  std::atomic<uint64_t> dataset_rows;
};

struct SharedHeader {
  uint64_t magic;
  uint32_t version;
  uint32_t worker_count;
  int64_t lease_ms;
  int64_t start_ms;  // MonotonicMs() of the daemon's start
  std::atomic<bool> draining;
  std::atomic<uint64_t> next_generation;
};

struct SharedMemory {
  SharedHeader header;
  std::array<ChildRecord, kMaxChildren> children;
  std::array<std::array<ThreadMark, kMarksPerWorker>, limits::kMaxWorkers> marks;
  std::array<SessionRecord, limits::kMaxSessions> sessions;
  std::array<LedgerRecord, limits::kMaxLedgers> ledgers;
  std::array<LaneSlotMemory, limits::kMaxLanes> lanes;
};
static_assert(std::atomic<uint64_t>::is_always_lock_free);

// Milliseconds of the clock that all processes of the machine share, exact to a few milliseconds,
// because it is asked for every lane of every step and must be cheap.
int64_t MonotonicMs();

// A mapping of the shared memory. Movable; unmaps on destruction. Any thread.
class SharedState {
 public:
  // Supervisor: fresh memory. `worker_count` is at most limits::kMaxWorkers.
  static Result<SharedState> Create(uint32_t worker_count, int64_t lease_ms);
  // Child: refuses memory of another size or version.
  static Result<SharedState> Map(int fd);

  int fd() const { return fd_.get(); }
  SharedHeader& header() const { return memory_->header; }
  // At most limits::kMaxWorkers, whatever the memory says.
  uint32_t worker_count() const;
  // The caller checks indices: each is below its array's size, `lane` below limits::kMaxLanes.
  ChildRecord& child(uint32_t index) const { return memory_->children[index]; }
  // Whether the environment worker of this number has no process at the moment.
  bool worker_is_down(uint32_t worker) const {
    return child(kFirstWorkerChild + worker).process_id == 0;
  }
  std::span<ThreadMark> marks(uint32_t worker) const { return memory_->marks[worker]; }
  SessionRecord& session(uint32_t index) const { return memory_->sessions[index]; }
  LedgerRecord& ledger(uint32_t index) const { return memory_->ledgers[index]; }
  LaneSlot lane(uint32_t index) const { return LaneSlot(&memory_->lanes[index]); }

 private:
  SharedState() = default;
  struct Unmap {
    void operator()(SharedMemory* memory) const;
  };
  // Maps the memory of `fd`.
  static Result<SharedState> MapAll(UniqueFd fd);

  UniqueFd fd_;
  std::unique_ptr<SharedMemory, Unmap> memory_;
};

// The checksum that belongs into `record.checksum`.
uint64_t SessionChecksum(const SessionRecord& record);
// kDataLoss unless lane range, sizes and checksum are sound.
Status CheckSessionRecord(const SessionRecord& record);
std::string_view SessionToken(const SessionRecord& record);
std::string_view SessionOpenBytes(const SessionRecord& record);  // of a checked record

}  // namespace b4mrl
