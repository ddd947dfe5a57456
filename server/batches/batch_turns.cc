#include "server/batches/batch_turns.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <functional>
#include <string_view>

#include "proto/base/limits.h"

namespace b4mrl {
namespace {

// In a millisecond some 10,000 rows are copied that lie in memory: more than most batches have.
constexpr std::chrono::milliseconds kSlice{1};
constexpr size_t kLargeBytes = 1024 * 1024;

// How many rows are copied between two looks at the clock: more and more while they lie in memory,
// one at a time where they come from the disk.
class Pace {
 public:
  explicit Pace(const std::function<void()>& alive) : alive_(alive) {}

  size_t operator()() {
    alive_();
    const Clock::time_point now = Clock::now();
    if (now >= end_) return 0;
    rows_ = now - last_ > kSlow ? 1 : std::min(2 * rows_, kMostRows);
    last_ = now;
    return rows_;
  }

 private:
  static constexpr std::chrono::microseconds kSlow{100};
  static constexpr size_t kMostRows = 32;

  const std::function<void()>& alive_;
  Clock::time_point last_ = Clock::now();
  const Clock::time_point end_ = last_ + kSlice;
  size_t rows_ = 1;
};

// Leaves out what a peer may have sent around the payload, which can take much memory.
void KeepPayloadAlone(PendingRequest* pending) {
  pending->request.clear_arrays();
  pending->request.clear_session_token();
  pending->request.DiscardUnknownFields();
  pending->request = pb::Request(pending->request);  // a copy has no room for what was cleared
  pending->contents.reset();
}

Status TooLate() {
  return Status(StatusCode::kDeadlineExceeded, "the rows were not read in time; ask again");
}

Status TooMany(std::string_view whose, size_t most) {
  return Status(StatusCode::kLimitExceeded,
                fmt::format("more requests for rows wait {}; allowed: {}", whose, most));
}

// How many replies of at most `each` bytes fit.
size_t PlacesIn(size_t bytes, size_t each) { return std::max<size_t>(1, bytes / each); }

}  // namespace

BatchTurns::BatchTurns(Hooks hooks, size_t bytes)
    : hooks_(std::move(hooks)),
      places_{{PlacesIn(bytes, kLargeBytes)}, {PlacesIn(bytes, limits::kMaxPayloadBytes)}} {}

BatchTurns::Size BatchTurns::SizeOf(const BatchJob& job) {
  return job.reply.payload_bytes() > kLargeBytes ? kLarge : kSmall;
}

bool BatchTurns::Fill(BatchJob* job) {
  Pace pace(hooks_.alive);
  return job->reply.Fill(std::ref(pace));
}

void BatchTurns::Add(BatchJob job) {
  const RoutingId peer = job.pending.from.peer;
  const auto found = connections_.find(peer);
  if (found != connections_.end()) return Append(&found->second, std::move(job));
  Places& places = places_[SizeOf(job)];
  const bool begins = places.waiting.empty() && places.taken < places.most;
  if (begins) {
    job.started = Clock::now();
    if (Fill(&job)) return hooks_.answer(std::move(job));
    ++places.taken;
    turns_.push_back(peer);
  } else {
    places.waiting.push_back(peer);
  }
  KeepPayloadAlone(&job.pending);
  Connection& connection = connections_[peer];
  connection.is_under_way = begins;
  connection.jobs.push_back(std::move(job));
  ++jobs_;
  MakeRoom();
}

void BatchTurns::Append(Connection* connection, BatchJob job) {
  KeepPayloadAlone(&job.pending);
  std::deque<BatchJob>& jobs = connection->jobs;
  for (BatchJob& other : jobs) {
    if (!IsCopy(&other.pending, &job.pending)) continue;
    other.pending.deadline = job.pending.deadline;  // the time that its sender gives it by now
    return;
  }
  if (jobs.size() > limits::kMaxRequestsInFlight) {
    Refuse(jobs[1], TooMany("on this connection", limits::kMaxRequestsInFlight));
    jobs.erase(jobs.begin() + 1);
    --jobs_;
  }
  jobs.push_back(std::move(job));
  ++jobs_;
  MakeRoom();
}

void BatchTurns::MakeRoom() {
  if (jobs_ <= limits::kMaxQueuedRequests) return;
  const auto most = std::ranges::max_element(
      connections_, {}, [](const auto& entry) { return entry.second.jobs.size(); });
  const Status status = TooMany("on all connections", limits::kMaxQueuedRequests);
  std::deque<BatchJob>& jobs = most->second.jobs;
  if (jobs.size() == 1) return Refuse(TakeFirst(most), status);
  Refuse(jobs.back(), status);
  jobs.pop_back();
  --jobs_;
}

BatchJob BatchTurns::TakeFirst(Connections::iterator connection) {
  const RoutingId peer = connection->first;
  auto& [jobs, is_under_way] = connection->second;
  BatchJob job = std::move(jobs.front());
  jobs.pop_front();
  --jobs_;
  Places& places = places_[SizeOf(job)];
  std::erase(is_under_way ? turns_ : places.waiting, peer);
  if (is_under_way) --places.taken;
  is_under_way = false;
  if (jobs.empty()) {
    connections_.erase(connection);
  } else {
    places_[SizeOf(jobs.front())].waiting.push_back(peer);
  }
  return job;
}

void BatchTurns::Turn() {
  for (const Size size : {kSmall, kLarge}) {
    Places& places = places_[size];
    for (; !places.waiting.empty() && places.taken < places.most; ++places.taken) {
      Connection& connection = connections_.at(places.waiting.front());
      connection.is_under_way = true;
      connection.jobs.front().started = Clock::now();
      turns_.push_back(std::move(places.waiting.front()));
      places.waiting.pop_front();
    }
  }
  if (turns_.empty()) return;
  const auto connection = connections_.find(turns_.front());
  if (Fill(&connection->second.jobs.front())) return hooks_.answer(TakeFirst(connection));
  turns_.push_back(std::move(turns_.front()));
  turns_.pop_front();
}

void BatchTurns::Expire() {
  for (auto next = connections_.begin(); next != connections_.end();) {
    const auto connection = next++;
    std::deque<BatchJob>& jobs = connection->second.jobs;
    const size_t before = jobs.size();
    for (size_t i = jobs.size() - 1; i > 0; --i) {
      if (!jobs[i].pending.deadline.expired()) continue;
      Refuse(jobs[i], TooLate());
      jobs.erase(jobs.begin() + static_cast<ptrdiff_t>(i));
    }
    jobs_ -= before - jobs.size();
    if (jobs.front().pending.deadline.expired()) Refuse(TakeFirst(connection), TooLate());
  }
}

void BatchTurns::RefuseAll(const Status& status) {
  while (!connections_.empty()) Refuse(TakeFirst(connections_.begin()), status);
}

}  // namespace b4mrl
