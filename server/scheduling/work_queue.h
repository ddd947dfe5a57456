// The work of one environment worker: requests are cut into pieces, and threads take the pieces so
// that each kind of work and each session gets its share of time.
//
// The next piece is of the kind of work that has had the least time, where a step's time counts a
// quarter, and of the session that has had the least time in that kind (fair_share.h). Requests of
// one session and kind keep their order of arrival. So steps have two thirds of a busy worker or
// more, no request waits for ever, and within a kind costly requests hold up only the session that
// sent them. A costly row is charged to its kind as well: after it the queries of all sessions wait
// while steps are wanted, for four times as long as the row took. A piece is cut when it is taken,
// by the time that items of its kind took lately, so a long request never blocks the others for
// more than one piece a thread. Where items have become much dearer meanwhile, the thread ends its
// piece early and puts the rest back (piece_timer.h); these items are the request's next ones.
//
// The socket's thread takes small pieces, bites, from the front of a request, the threads of the
// pool take theirs from its end: when a session sends the same lanes again and again, each thread
// finds its lanes in its core's cache. Items that take too long for a bite are left to a stand-in,
// one thread more, which works while the socket's thread finds nothing but such items. Where there
// is no pool, which would take them in their turn, it also works when they are next.
//
// Thread-safe. The queue owns nothing: the owner of a QueuedWork keeps it until its last piece was
// executed, and finds that out by itself.
#pragma once

#include <array>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <optional>
#include <vector>

#include "proto/base/clock.h"
#include "proto/base/spin.h"
#include "server/scheduling/fair_share.h"
#include "server/scheduling/item_cost.h"

namespace b4mrl {

enum class WorkKind : uint8_t { kLanes = 0, kQuery = 1, kOther = 2 };
inline constexpr size_t kWorkKinds = 3;

// The queue's view of a request.
struct QueuedWork {
  virtual ~QueuedWork() = default;

  uint32_t session = 0;  // the account that its time is charged to; a small number
  WorkKind work_kind = WorkKind::kOther;
  uint32_t items = 0;        // at least 1
  ItemCost* cost = nullptr;  // of items of this session and kind of request; outlives the work
  Deadline deadline = Deadline::AfterMs(0);
  // The result counts only as a whole, so the deadline ends the work even after it has begun.
  bool ends_at_deadline = false;

 private:
  friend class WorkQueue;
  struct Range {
    uint32_t first, count;
  };
  // Items that no thread has, and none has executed: front_ to items - taken_from_end_, and those
  // that were put back.
  uint32_t left() const { return items - front_ - taken_from_end_ + put_back_items_; }
  uint32_t front_ = 0;
  uint32_t taken_from_end_ = 0;
  std::vector<Range> put_back_;  // disjoint, so fewer than items
  uint32_t put_back_items_ = 0;
  uint64_t arrival_ = 0;  // a number that grows with every Push
};

struct Piece {
  QueuedWork* work = nullptr;
  uint32_t first = 0;
  uint32_t count = 0;
  // True: the deadline has passed. The piece holds all items that are left, wherever they are in
  // the work, not to be executed.
  bool expired = false;
  double expected_us = 0;
};

class WorkQueue {
 public:
  // `threads` includes the socket's thread, but not the stand-in.
  explicit WorkQueue(uint32_t threads) : threads_(threads) {}

  // `caller_helps`: the caller or the stand-in takes pieces too, so work for a single thread wakes
  // none of the pool, unless its items are too long for the caller and the stand-in is at work.
  void Push(QueuedWork* work, bool caller_helps = true);
  // For threads of the pool: waits for a piece; nothing once Stop was called. `spinner` is the
  // thread's own.
  std::optional<Piece> Take(Spinner& spinner);
  // For the socket's thread: a bite, if any work has items that are short enough.
  std::optional<Piece> TryTakeBite();
  // For the stand-in: waits until TryTakeBite has found nothing but items that are too long or,
  // without a pool, such items next, then takes a piece; nothing once Stop was called.
  std::optional<Piece> TakeInstead();
  // All items left of `work`, which is in the queue, if its deadline has passed and may end it.
  std::optional<Piece> TakeExpired(QueuedWork* work);
  // Charges the microseconds that a piece took; to be called before the piece's work may end.
  void Settle(const Piece& piece, double us);
  // Takes back the items of a piece behind the first `done`, at least 1, which were executed; to be
  // called after Settle, and before these may count as done.
  void PutBack(const Piece& piece, uint32_t done);
  // Cancels the debt of time of account `session`, because a new session has got this number.
  void Forget(uint32_t session);

  // Lets every Take and TakeInstead return nothing. Work that is left stays in the queue.
  void Stop();
  bool empty() const;

 private:
  // The sessions with work of one kind.
  struct Line {
    FairShare sessions;
    std::vector<std::vector<QueuedWork*>> work;  // by session, in the order of arrival
  };
  Line& LineOf(const QueuedWork& work) { return lines_[static_cast<size_t>(work.work_kind)]; }
  // Takes a piece of any work, or, if `bite`, a bite of work whose items are short enough.
  std::optional<Piece> TakeLocked(bool bite);
  // Whether the work that is next, of all, has items that are too long for a bite.
  bool NextIsTooLong() const;
  Piece Cut(QueuedWork* work, bool bite);
  // Takes up to `count` items out of those that are left, from their front or from their end.
  QueuedWork::Range TakeItems(QueuedWork* work, uint32_t count, bool from_front);
  // Puts work into its line, behind what has arrived before it.
  void Insert(QueuedWork* work);
  // Invites threads of the pool that spin, up to `wanted`, and returns how many more to wake.
  uint32_t Invite(uint32_t wanted);
  // After a cut: takes the work out of its line if no item is left.
  void RemoveIfTaken(QueuedWork* work);
  void Serve(const QueuedWork& work, double us);
  // Waits until Push wants one thread more; may return without that.
  void AwaitInvitation(std::unique_lock<std::mutex>& lock, Spinner& spinner);

  const uint32_t threads_;
  mutable std::mutex mutex_;
  std::condition_variable available_;
  std::condition_variable left_;
  FairShare kinds_;
  std::array<Line, kWorkKinds> lines_;
  uint64_t arrivals_ = 0;
  std::atomic<bool> stopped_ = false;
  // Threads that wait in Take. One that spins would take work which the socket's thread is about to
  // do itself, so it waits until Push invites it.
  uint32_t spinning_ = 0;
  uint32_t sleeping_ = 0;
  std::atomic<uint32_t> invitations_ = 0;  // of threads that spin; at most spinning_
  bool bites_left_it_ = false;             // the last TryTakeBite left items to the stand-in
  bool stand_in_waits_ = false;            // in TakeInstead, without having been told to work
};

}  // namespace b4mrl
