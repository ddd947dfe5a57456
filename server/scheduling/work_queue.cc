#include "server/scheduling/work_queue.h"

#include <algorithm>
#include <iterator>

namespace b4mrl {
namespace {

// Weights of the kinds of work. Steps count most, as a client that steps waits for every answer,
// and most clients of a worker step.
constexpr std::array<double, kWorkKinds> kWeights = {4, 1, 1};

bool MayEnd(const QueuedWork& work, bool begun) {
  return (!begun || work.ends_at_deadline) && work.deadline.expired();
}

}  // namespace

void WorkQueue::Push(QueuedWork* work, bool caller_helps) {
  uint32_t wake = 0;
  {
    std::lock_guard lock(mutex_);
    // Items that are too long for the caller wait for the stand-in, which may be at work.
    const bool caller_can = !work->cost->too_long_for_bites() || stand_in_waits_;
    const uint32_t for_caller = caller_helps && caller_can && kinds_.empty() ? 1 : 0;
    work->arrival_ = arrivals_++;
    Insert(work);
    bites_left_it_ = false;  // until the socket's thread has looked at the new work
    wake = Invite(work->cost->ThreadsFor(work->items, threads_) - for_caller);
  }
  for (uint32_t i = 0; i < wake; ++i) available_.notify_one();
}

void WorkQueue::Insert(QueuedWork* work) {
  Line& line = LineOf(*work);
  if (line.sessions.empty()) kinds_.Enter(static_cast<uint32_t>(work->work_kind));
  if (work->session >= line.work.size()) line.work.resize(work->session + 1);
  std::vector<QueuedWork*>& own = line.work[work->session];
  if (own.empty()) line.sessions.Enter(work->session);
  auto place = own.end();
  while (place != own.begin() && (*std::prev(place))->arrival_ > work->arrival_) --place;
  own.insert(place, work);
}

uint32_t WorkQueue::Invite(uint32_t wanted) {
  const uint32_t invited = std::min(wanted, spinning_ - invitations_);
  invitations_ += invited;
  return std::min(wanted - invited, sleeping_);
}

Piece WorkQueue::Cut(QueuedWork* work, bool bite) {
  const uint32_t left = work->left();
  if (MayEnd(*work, left < work->items)) {
    work->front_ = work->items - work->taken_from_end_;
    work->put_back_.clear();
    work->put_back_items_ = 0;
    return {work, 0, left, true, 0};
  }
  const ItemCost& cost = *work->cost;
  const uint32_t wanted =
      std::min(cost.ItemsPerPiece(left, threads_), bite ? cost.ItemsPerBite() : left);
  const auto [first, count] = TakeItems(work, wanted, bite);
  const double us = cost.Expect(count);
  Serve(*work, us);
  return {work, first, count, false, us};
}

QueuedWork::Range WorkQueue::TakeItems(QueuedWork* work, uint32_t count, bool from_front) {
  if (!work->put_back_.empty()) {
    QueuedWork::Range& rest = work->put_back_.back();
    count = std::min(count, rest.count);
    const uint32_t first = from_front ? rest.first : rest.first + rest.count - count;
    if (from_front) rest.first += count;
    rest.count -= count;
    work->put_back_items_ -= count;
    if (rest.count == 0) work->put_back_.pop_back();
    return {first, count};
  }
  if (from_front) {
    work->front_ += count;
    return {work->front_ - count, count};
  }
  work->taken_from_end_ += count;
  return {work->items - work->taken_from_end_, count};
}

void WorkQueue::PutBack(const Piece& piece, uint32_t done) {
  QueuedWork* work = piece.work;
  uint32_t wake = 0;
  {
    std::lock_guard lock(mutex_);
    if (work->left() == 0) Insert(work);
    const uint32_t rest = piece.count - done;
    work->put_back_.push_back({piece.first + done, rest});
    work->put_back_items_ += rest;
    // The calling thread takes its next piece itself. When the work arrived, fewer threads seemed
    // to be worth waking.
    wake = Invite(work->cost->ThreadsFor(work->left(), threads_) - 1);
  }
  for (uint32_t i = 0; i < wake; ++i) available_.notify_one();
}

void WorkQueue::Serve(const QueuedWork& work, double us) {
  const auto kind = static_cast<uint32_t>(work.work_kind);
  kinds_.Serve(kind, us / kWeights[kind]);
  lines_[kind].sessions.Serve(work.session, us);
}

void WorkQueue::Settle(const Piece& piece, double us) {
  std::lock_guard lock(mutex_);
  const auto kind = static_cast<uint32_t>(piece.work->work_kind);
  kinds_.Correct(kind, (us - piece.expected_us) / kWeights[kind]);
  lines_[kind].sessions.Correct(piece.work->session, us - piece.expected_us);
}

void WorkQueue::Forget(uint32_t session) {
  std::lock_guard lock(mutex_);
  for (Line& line : lines_) line.sessions.Forget(session);
}

void WorkQueue::RemoveIfTaken(QueuedWork* work) {
  if (work->left() > 0) return;
  Line& line = LineOf(*work);
  std::vector<QueuedWork*>& own = line.work[work->session];
  std::erase(own, work);
  if (own.empty()) line.sessions.Leave(work->session);
  if (line.sessions.empty()) kinds_.Leave(static_cast<uint32_t>(work->work_kind));
}

std::optional<Piece> WorkQueue::TakeLocked(bool bite) {
  const auto next_session = [&](uint32_t kind) {
    const Line& line = lines_[kind];
    return line.sessions.Next([&](uint32_t session) {
      return !bite || !line.work[session].front()->cost->too_long_for_bites();
    });
  };
  std::optional<uint32_t> session;  // of the last accepted kind, which is served next
  const std::optional<uint32_t> kind = kinds_.Next([&](uint32_t candidate) {
    const std::optional<uint32_t> found = next_session(candidate);
    if (found) session = found;
    return found.has_value();
  });
  if (!kind) return std::nullopt;
  QueuedWork* work = lines_[*kind].work[*session].front();
  const Piece piece = Cut(work, bite);
  RemoveIfTaken(work);
  return piece;
}

bool WorkQueue::NextIsTooLong() const {
  const auto any = [](uint32_t) { return true; };
  const std::optional<uint32_t> kind = kinds_.Next(any);
  if (!kind) return false;
  const Line& line = lines_[*kind];
  return line.work[*line.sessions.Next(any)].front()->cost->too_long_for_bites();
}

std::optional<Piece> WorkQueue::Take(Spinner& spinner) {
  std::unique_lock lock(mutex_);
  while (!stopped_) {
    if (std::optional<Piece> piece = TakeLocked(false)) return piece;
    AwaitInvitation(lock, spinner);
  }
  return std::nullopt;
}

void WorkQueue::AwaitInvitation(std::unique_lock<std::mutex>& lock, Spinner& spinner) {
  const Clock::time_point since = Clock::now();
  ++spinning_;
  lock.unlock();
  spinner.Spin(since, [this] { return invitations_ > 0 || stopped_; });
  lock.lock();
  --spinning_;
  if (invitations_ > 0) {
    --invitations_;
  } else if (!stopped_) {
    ++sleeping_;
    available_.wait(lock);
    --sleeping_;
  }
  spinner.Learn(Clock::now() - since);
}

std::optional<Piece> WorkQueue::TryTakeBite() {
  std::unique_lock lock(mutex_);
  if (stopped_) return std::nullopt;
  const bool leaves_next = threads_ == 1 && NextIsTooLong();
  const std::optional<Piece> piece = TakeLocked(true);
  bites_left_it_ = leaves_next || (!piece && !kinds_.empty());
  if (!bites_left_it_) return piece;
  stand_in_waits_ = false;  // it is told to work
  lock.unlock();
  left_.notify_one();
  return piece;
}

std::optional<Piece> WorkQueue::TakeInstead() {
  std::unique_lock lock(mutex_);
  while (!stopped_) {
    stand_in_waits_ = false;
    std::optional<Piece> piece = bites_left_it_ ? TakeLocked(false) : std::nullopt;
    if (piece) return piece;
    stand_in_waits_ = true;
    left_.wait(lock);
  }
  return std::nullopt;
}

std::optional<Piece> WorkQueue::TakeExpired(QueuedWork* work) {
  std::lock_guard lock(mutex_);
  const uint32_t left = work->left();
  if (left == 0 || !MayEnd(*work, left < work->items)) return std::nullopt;
  const Piece piece = Cut(work, false);
  RemoveIfTaken(work);
  return piece;
}

void WorkQueue::Stop() {
  {
    std::lock_guard lock(mutex_);
    stopped_ = true;
  }
  available_.notify_all();
  left_.notify_all();
}

bool WorkQueue::empty() const {
  std::lock_guard lock(mutex_);
  return kinds_.empty();
}

}  // namespace b4mrl
