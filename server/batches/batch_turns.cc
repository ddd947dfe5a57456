#include "server/batches/batch_turns.h"

#include <algorithm>

#include "proto/base/limits.h"

namespace b4mrl {
namespace {

// In a millisecond some 10,000 rows are copied that lie in memory: more than most batches have.
constexpr int64_t kSliceMs = 1;
constexpr size_t kLargeBytes = 1024 * 1024;
constexpr int kMaxLarge = 8;

bool IsLarge(size_t payload_bytes) { return payload_bytes > kLargeBytes; }

// A copy without what a peer may have sent around the payload, which can take much memory.
pb::Request PayloadAlone(pb::Request request) {
  request.clear_arrays();
  request.DiscardUnknownFields();
  return pb::Request(request);
}

}  // namespace

bool BatchTurns::MayBegin(const RoutingId& peer, size_t payload_bytes) const {
  const auto is_of_peer = [&](const BatchJob& job) { return job.pending.from.peer == peer; };
  const auto is_large = [](const BatchJob& job) { return IsLarge(job.reply.payload_bytes()); };
  return std::ranges::none_of(jobs_, is_of_peer) &&
         (!IsLarge(payload_bytes) || std::ranges::count_if(jobs_, is_large) < kMaxLarge);
}

std::optional<BatchJob> BatchTurns::Begin(BatchJob job) {
  const Deadline slice = Deadline::AfterMs(kSliceMs);
  job.complete = job.reply.Fill([&] {
    alive_();
    return !slice.expired();
  });
  if (job.complete) return job;
  jobs_.push_back(std::move(job));
  return std::nullopt;
}

std::optional<BatchJob> BatchTurns::Next() {
  if (jobs_.empty()) return std::nullopt;
  BatchJob job = std::move(jobs_.front());
  jobs_.pop_front();
  if (job.pending.deadline.expired()) return job;
  return Begin(std::move(job));
}

PendingRequest* BatchTurns::FindOriginal(PendingRequest* copy) {
  for (BatchJob& job : jobs_) {
    if (IsCopy(&job.pending, copy)) return &job.pending;
  }
  for (Waiting& waiting : waiting_) {
    if (IsCopy(&waiting.pending, copy)) return &waiting.pending;
  }
  return nullptr;
}

Status BatchTurns::Wait(PendingRequest pending, size_t payload_bytes) {
  pending.request = PayloadAlone(std::move(pending.request));
  if (PendingRequest* original = FindOriginal(&pending)) {
    original->deadline = pending.deadline;  // the time that its sender gives it by now
    return Status();
  }
  const size_t of_peer = std::ranges::count_if(
      waiting_, [&](const auto& other) { return other.pending.from.peer == pending.from.peer; });
  B4MRL_RETURN_IF_ERROR(CheckWaiting("requests for rows", {waiting_.size(), of_peer},
                                     {limits::kMaxQueuedRequests, limits::kMaxRequestsInFlight}));
  waiting_.push_back({std::move(pending), payload_bytes});
  return Status();
}

std::optional<PendingRequest> BatchTurns::TakeWaiting() {
  const auto next = std::ranges::find_if(waiting_, [&](const Waiting& waiting) {
    return waiting.pending.deadline.expired() ||
           MayBegin(waiting.pending.from.peer, waiting.payload_bytes);
  });
  if (next == waiting_.end()) return std::nullopt;
  PendingRequest pending = std::move(next->pending);
  waiting_.erase(next);
  return pending;
}

std::vector<PendingRequest> BatchTurns::TakeAll() {
  std::vector<PendingRequest> all;
  for (BatchJob& job : std::exchange(jobs_, {})) all.push_back(std::move(job.pending));
  for (Waiting& waiting : std::exchange(waiting_, {})) all.push_back(std::move(waiting.pending));
  return all;
}

}  // namespace b4mrl
