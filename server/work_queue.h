// The work of one environment worker: requests cut into pieces, shared out fairly.
//
// Pieces leave by priority first, then in turn over the sessions that have work at that priority,
// then in the order of arrival within a session. A piece is cut when it is taken, so a long request
// never blocks the others for more than one piece per thread. Threads of the pool cut from the end
// of a request, the socket's thread from its front: where a session sends the same lanes again and
// again, each finds its own in its core's cache. Thread-safe. The queue owns nothing: a QueuedWork
// lives until its last piece was executed, which its owner learns by itself.
#pragma once

#include <array>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <list>
#include <mutex>
#include <optional>
#include <unordered_map>

#include "proto/base/clock.h"

namespace b4mrl {

enum class Priority : uint8_t { kLanes = 0, kQuery = 1, kOther = 2 };
inline constexpr size_t kPriorities = 3;

// The queue's view of a request.
struct QueuedWork {
  virtual ~QueuedWork() = default;

  uint32_t session = 0;  // whose turn it uses
  Priority priority = Priority::kOther;
  uint32_t items = 0;            // at least 1
  uint32_t items_per_piece = 1;  // at least 1
  uint32_t items_per_bite = 1;   // at least 1: the piece of a thread that must be back soon
  Deadline deadline = Deadline::AfterMs(0);

 private:
  friend class WorkQueue;
  // What nobody has taken yet: items front_ to items - taken_from_end_.
  uint32_t front_ = 0;
  uint32_t taken_from_end_ = 0;
};

struct Piece {
  QueuedWork* work = nullptr;
  uint32_t first = 0;
  uint32_t count = 0;
  // The deadline passed before any item was started: the piece spans all items, none is to be
  // executed.
  bool expired = false;
};

class WorkQueue {
 public:
  // A caller that helps takes bites itself, so one piece alone wakes nobody.
  void Push(QueuedWork* work, bool caller_helps = true);
  // Waits for a piece; nothing once Stop was called.
  std::optional<Piece> Take();
  // At most items_per_bite from the front, if there is anything.
  std::optional<Piece> TryTakeBite();
  // Lets every Take return; pieces that were not taken stay where they are.
  void Stop();
  bool empty() const;

 private:
  // The sessions with work at one priority, in turn.
  struct Ring {
    std::list<uint32_t> turns;
    std::unordered_map<uint32_t, std::deque<QueuedWork*>> work;
  };
  std::optional<Piece> TakeLocked(bool bite);
  static Piece CutFrom(QueuedWork* work, bool bite);
  bool EmptyLocked() const;

  mutable std::mutex mutex_;
  std::condition_variable available_;
  std::array<Ring, kPriorities> rings_;
  bool stopped_ = false;
  uint32_t sleeping_ = 0;
};

}  // namespace b4mrl
