// The work of one environment worker: requests cut into pieces, shared out by the time they take.
//
// The next piece is of the kind of work that has had the least time, where a step's time counts a
// quarter, and there of the session that has had the least time (fair_share.h); within these in the
// order of arrival. So steps have two thirds of a busy worker or more, nothing waits
// for ever, and costly requests hold up only those who sent them. A piece is cut when it is taken,
// by what items of its kind took lately, so a long request never blocks the others for more than
// one piece per thread.
//
// Threads of the pool cut from the end of a request, the socket's thread from its front: where a
// session sends the same lanes again and again, each finds its own in its core's cache. Items that
// would keep the socket's thread from its messages are none of its business: while it finds no
// others, a stand-in takes its place. Thread-safe. The queue owns nothing: a QueuedWork lives until
// its last piece was executed, which its owner learns by itself.
#pragma once

#include <array>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <optional>
#include <vector>

#include "proto/base/clock.h"
#include "server/scheduling/fair_share.h"
#include "server/scheduling/item_cost.h"

namespace b4mrl {

enum class WorkKind : uint8_t { kLanes = 0, kQuery = 1, kOther = 2 };
inline constexpr size_t kWorkKinds = 3;

// The queue's view of a request.
struct QueuedWork {
  virtual ~QueuedWork() = default;

  uint32_t session = 0;  // whose time it takes; a small number
  WorkKind work_kind = WorkKind::kOther;
  uint32_t items = 0;        // at least 1
  ItemCost* cost = nullptr;  // of such items; outlives the work
  Deadline deadline = Deadline::AfterMs(0);
  // Nothing of it counts before all of it is done, so its deadline ends it even when it has begun.
  bool ends_at_deadline = false;

 private:
  friend class WorkQueue;
  // What nobody has taken yet: items front_ to items - taken_from_end_.
  uint32_t left() const { return items - front_ - taken_from_end_; }
  uint32_t front_ = 0;
  uint32_t taken_from_end_ = 0;
};

struct Piece {
  QueuedWork* work = nullptr;
  uint32_t first = 0;
  uint32_t count = 0;
  // The deadline has passed: these are all items that are left, and none is to be executed.
  bool expired = false;
  double expected_us = 0;
};

class WorkQueue {
 public:
  // For so many threads, the socket's included.
  explicit WorkQueue(uint32_t threads) : threads_(threads) {}

  // A caller that helps takes bites itself, or its stand-in does, so one piece alone wakes nobody.
  void Push(QueuedWork* work, bool caller_helps = true);
  // Waits for a piece; nothing once Stop was called.
  std::optional<Piece> Take();
  // A bite from the front, if there is work for bites.
  std::optional<Piece> TryTakeBite();
  // Waits until TryTakeBite has left all there is, then takes a piece of that; nothing once Stop
  // was called.
  std::optional<Piece> TakeInstead();
  // The rest of `work`, which is in the queue, if its deadline has passed and may end it.
  std::optional<Piece> TakeExpired(QueuedWork* work);
  // What a piece took, in microseconds; before its work may end.
  void Settle(const Piece& piece, double us);

  // Lets every Take return; pieces that were not taken stay where they are.
  void Stop();
  bool empty() const;

 private:
  // The sessions with work of one kind.
  struct Line {
    FairShare sessions;
    std::vector<std::vector<QueuedWork*>> work;  // by session, in the order of arrival
  };
  Line& LineOf(const QueuedWork& work) { return lines_[static_cast<size_t>(work.work_kind)]; }
  // Of any work, or of what is for bites.
  std::optional<Piece> TakeLocked(bool bite);
  Piece Cut(QueuedWork* work, bool bite);
  // After a cut: out of the line if nothing is left.
  void RemoveIfTaken(QueuedWork* work);
  void Serve(const QueuedWork& work, double us);

  const uint32_t threads_;
  mutable std::mutex mutex_;
  std::condition_variable available_;
  std::condition_variable left_;
  FairShare kinds_;
  std::array<Line, kWorkKinds> lines_;
  bool stopped_ = false;
  uint32_t sleeping_ = 0;       // in Take
  bool bites_left_it_ = false;  // TryTakeBite found work, but none for bites
};

}  // namespace b4mrl
