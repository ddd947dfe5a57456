// The memory that outlives every child: which children run, which sessions exist, what each lane
// last did. The supervisor creates it (an anonymous, sparse memfd) and passes its descriptor on;
// every child maps all of it.
//
// Who writes what: the supervisor the children's process ids and restarts and the lanes' blame; the
// gateway a session's record, but for what its worker says of it: its lanes, its activity and that
// it is closed; each thread its own mark. Numbers that several processes touch are atomics.
// Whatever a process reads that another wrote is checked before it is used as an index or a length:
// the writer may have died of a wild pointer.
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
};

// What one thread of a worker is executing, so that a death can be blamed on somebody.
enum class MarkKind : uint32_t {
  kIdle = 0,
  kLane = 1,     // an operation of a lane
  kRequest = 2,  // a request: its examination, a row of a query, a snapshot
  kSession = 3,  // the building of a session
};
struct alignas(64) ThreadMark {
  std::atomic<MarkKind> kind;      // stored last when work begins, first when it ends
  std::atomic<uint32_t> guilty;    // it raised the deadly signal, or the supervisor saw it frozen
  std::atomic<uint32_t> lane;      // kLane: index into SharedState::lane
  std::atomic<uint32_t> session;   // the others: index into SharedState::session
  std::atomic<uint64_t> number;    // the operation, the request's id, the session's generation
  std::atomic<uint64_t> attempt;   // kLane: its AttemptKey
  std::atomic<int64_t> since_ms;   // MonotonicMs() when it began
  std::atomic<int32_t> thread_id;  // the system's
};
inline constexpr uint32_t kMarksPerWorker =
    limits::kMaxThreads + 1;  // the socket's thread is mark 0

enum class SessionState : uint32_t {
  kFree = 0,     // may be allocated
  kOpening = 1,  // allocated by the gateway, not yet acknowledged by the worker
  kLive = 2,     // acknowledged: its worker serves it
  kClosed = 3,   // the worker is done with it; the gateway frees it
};

// Blame for a request, by its id, as a lane slot has it for an operation. 0: nobody's.
struct RequestBlame {
  std::atomic<uint64_t> request_id;
  std::atomic<uint32_t> blame;
};

struct alignas(64) SessionRecord {
  std::atomic<SessionState> granted;  // by the gateway: kFree, kOpening or kLive; state() holds
  std::atomic<uint32_t> worker;
  std::atomic<uint32_t> first_lane;
  std::atomic<uint32_t> lane_count;
  std::atomic<uint64_t> generation;         // never repeats; its lanes carry it too
  std::atomic<uint64_t> closed_generation;  // the last one that its worker was done with
  std::atomic<int64_t> last_activity_ms;    // MonotonicMs()
  std::atomic<uint64_t> steps;
  std::atomic<uint32_t> build_deaths;    // of workers while they built it, one after the other
  std::atomic<uint64_t> simulator_hash;  // of what the lanes were made with
  std::array<RequestBlame, 4> request_blames;  // the most blamed ones
  std::array<uint8_t, limits::kTokenBytes> token;
  uint64_t request_hash;  // of the OpenRequest as it came, for the same token again
  // The serialised pb::OpenRequest with its seed filled in, and a checksum over it, the token and
  // the lane range.
  uint64_t checksum;
  uint32_t open_size;
  std::array<std::byte, limits::kMaxOpenRequestBytes> open;

  SessionState state() const;
  // Its worker: done with the session of that generation, whether the gateway has acknowledged it
  // or not. A session that got the record since is not touched: gateway and worker decide at the
  // same time, but neither overwrites what the other says.
  void Close(uint64_t its_generation) {
    closed_generation.store(its_generation, std::memory_order_release);
  }
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
  std::array<LaneSlotMemory, limits::kMaxLanes> lanes;
};
static_assert(std::atomic<uint64_t>::is_always_lock_free);

// Milliseconds of the clock that all processes of the machine share, exact to a few of them: every
// lane of every step asks.
int64_t MonotonicMs();

// A mapping of the shared memory. Movable; unmaps on destruction. Any thread.
class SharedState {
 public:
  // Supervisor: fresh memory. `worker_count` is at most limits::kMaxWorkers.
  static Result<SharedState> Create(uint32_t worker_count, int64_t lease_ms);
  // Child: refuses memory of another size or version.
  static Result<SharedState> Map(int fd);
  SharedState(SharedState&& other) noexcept;
  SharedState& operator=(SharedState&& other) noexcept;
  ~SharedState();

  int fd() const { return fd_; }
  SharedHeader& header() const { return memory_->header; }
  // At most limits::kMaxWorkers, whatever the memory says.
  uint32_t worker_count() const;
  // Indices are the caller's to check; `lane` is below limits::kMaxLanes, and so on.
  ChildRecord& child(uint32_t index) const { return memory_->children[index]; }
  std::span<ThreadMark> marks(uint32_t worker) const { return memory_->marks[worker]; }
  SessionRecord& session(uint32_t index) const { return memory_->sessions[index]; }
  LaneSlot lane(uint32_t index) const { return LaneSlot(&memory_->lanes[index]); }

 private:
  SharedState(int fd, SharedMemory* memory) : fd_(fd), memory_(memory) {}
  int fd_ = -1;
  SharedMemory* memory_ = nullptr;
};

// The checksum that belongs into `record.checksum`.
uint64_t SessionChecksum(const SessionRecord& record);
// kDataLoss unless lane range, sizes and checksum are sound.
Status CheckSessionRecord(const SessionRecord& record);
std::string_view SessionToken(const SessionRecord& record);
std::string_view SessionOpenBytes(const SessionRecord& record);  // of a checked record

}  // namespace b4mrl
