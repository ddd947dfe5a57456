#include "server/work_queue.h"

#include <algorithm>

namespace b4mrl {

void WorkQueue::Push(QueuedWork* work, bool caller_helps) {
  uint32_t wake = 0;
  {
    std::lock_guard lock(mutex_);
    const uint32_t for_caller = caller_helps && EmptyLocked() ? 1 : 0;
    Ring& ring = rings_[static_cast<size_t>(work->priority)];
    std::deque<QueuedWork*>& own = ring.work[work->session];
    if (own.empty()) ring.turns.push_back(work->session);
    own.push_back(work);
    const uint32_t pieces = (work->items + work->items_per_piece - 1) / work->items_per_piece;
    wake = std::min(pieces - for_caller, sleeping_);
  }
  for (uint32_t i = 0; i < wake; ++i) available_.notify_one();
}

Piece WorkQueue::CutFrom(QueuedWork* work, uint32_t fraction) {
  if (work->next_item_ == 0 && work->deadline.expired()) {
    work->next_item_ = work->items;
    return {work, 0, work->items, true};
  }
  const uint32_t first = work->next_item_;
  const uint32_t count = std::max(1u, work->items_per_piece / fraction);
  work->next_item_ = std::min(work->items, first + count);
  return {work, first, work->next_item_ - first, false};
}

std::optional<Piece> WorkQueue::TakeLocked(uint32_t fraction) {
  for (Ring& ring : rings_) {
    if (ring.turns.empty()) continue;
    const uint32_t session = ring.turns.front();
    ring.turns.pop_front();
    const auto own = ring.work.find(session);
    const Piece piece = CutFrom(own->second.front(), fraction);
    if (piece.first + piece.count == piece.work->items) own->second.pop_front();
    if (own->second.empty()) {
      ring.work.erase(own);
    } else {
      ring.turns.push_back(session);
    }
    return piece;
  }
  return std::nullopt;
}

std::optional<Piece> WorkQueue::Take() {
  std::unique_lock lock(mutex_);
  while (!stopped_) {
    if (std::optional<Piece> piece = TakeLocked(1)) return piece;
    ++sleeping_;
    available_.wait(lock);
    --sleeping_;
  }
  return std::nullopt;
}

std::optional<Piece> WorkQueue::TryTake(uint32_t fraction) {
  std::lock_guard lock(mutex_);
  return stopped_ ? std::nullopt : TakeLocked(fraction);
}

void WorkQueue::Stop() {
  {
    std::lock_guard lock(mutex_);
    stopped_ = true;
  }
  available_.notify_all();
}

bool WorkQueue::empty() const {
  std::lock_guard lock(mutex_);
  return EmptyLocked();
}

bool WorkQueue::EmptyLocked() const {
  return std::all_of(rings_.begin(), rings_.end(),
                     [](const Ring& ring) { return ring.turns.empty(); });
}

}  // namespace b4mrl
