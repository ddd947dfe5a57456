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

Piece WorkQueue::CutFrom(QueuedWork* work, bool bite) {
  const uint32_t left = work->items - work->front_ - work->taken_from_end_;
  if (left == work->items && work->deadline.expired()) {
    work->front_ = work->items;
    return {work, 0, work->items, true};
  }
  const uint32_t count =
      std::min(left, std::max(1u, bite ? work->items_per_bite : work->items_per_piece));
  if (bite) {
    work->front_ += count;
    return {work, work->front_ - count, count, false};
  }
  work->taken_from_end_ += count;
  return {work, work->items - work->taken_from_end_, count, false};
}

std::optional<Piece> WorkQueue::TakeLocked(bool bite) {
  for (Ring& ring : rings_) {
    if (ring.turns.empty()) continue;
    const uint32_t session = ring.turns.front();
    ring.turns.pop_front();
    const auto own = ring.work.find(session);
    QueuedWork* work = own->second.front();
    const Piece piece = CutFrom(work, bite);
    if (work->front_ + work->taken_from_end_ == work->items) own->second.pop_front();
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
    if (std::optional<Piece> piece = TakeLocked(false)) return piece;
    ++sleeping_;
    available_.wait(lock);
    --sleeping_;
  }
  return std::nullopt;
}

std::optional<Piece> WorkQueue::TryTakeBite() {
  std::lock_guard lock(mutex_);
  return stopped_ ? std::nullopt : TakeLocked(true);
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
