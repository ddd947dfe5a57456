#include "server/datasets/preparation_queue.h"

#include <algorithm>
#include <array>
#include <tuple>
#include <utility>

namespace b4mrl {
namespace {

// The turn of a job grows by this factor from one start to the next, so that the work that is
// thrown away adds up to a third of the last turn.
constexpr int64_t kTurnGrowth = 4;

}  // namespace

PreparationQueue::PreparationQueue(size_t short_places, size_t long_places, int64_t short_ms)
    : short_places_(short_places), long_places_(long_places), short_ms_(short_ms) {
  for (size_t i = 0; i < short_places + long_places; ++i) {
    places_.push_back(std::make_unique<BackgroundThread>());
    free_.push_back(places_.back().get());
  }
}

PreparationQueue::~PreparationQueue() {
  for (const Job& job : jobs_) {
    if (job.place != nullptr) *job.cancelled = true;
  }
  places_.clear();
}

void PreparationQueue::Submit(const std::string& key, uint64_t bytes, Work work, Request request) {
  ++backlog_;
  auto job = std::ranges::find(jobs_, key, &Job::key);
  if (job == jobs_.end()) {
    jobs_.push_back({.number = next_number_++,
                     .key = key,
                     .bytes = bytes,
                     .work = std::move(work),
                     .turn_ms = short_ms_});
    job = std::prev(jobs_.end());
  }
  job->requests.push_back(std::move(request));
}

size_t PreparationQueue::BacklogOf(const RoutingId& client) const {
  size_t requests = 0;
  for (const Job& job : jobs_) {
    requests += std::ranges::count(job.requests, client, &Request::client);
  }
  return requests;
}

void PreparationQueue::AddDescriptors(std::vector<int>* fds) const {
  for (const Job& job : jobs_) {
    if (job.place != nullptr) fds->push_back(job.place->fd());
  }
}

void PreparationQueue::Run() {
  if (jobs_.empty()) return;
  for (const auto& place : places_) place->RunCompletions();
  MakeWay();
  for (const bool is_long : {false, true}) {
    const size_t places = is_long ? long_places_ : short_places_;
    while (!free_.empty() && CountRunning(is_long) < places) {
      const auto job = NextWaiting(is_long);
      if (job == jobs_.end()) break;
      const bool waited_for = std::ranges::any_of(
          job->requests, [](const Request& request) { return request.waits(); });
      if (waited_for) {
        Start(&*job);
      } else {
        Remove(job);
      }
    }
  }
}

size_t PreparationQueue::CountRunning(bool is_long) const {
  return std::ranges::count_if(
      jobs_, [&](const Job& job) { return job.place != nullptr && job.is_long == is_long; });
}

size_t PreparationQueue::CountRunningOf(const Job& job) const {
  return std::ranges::count_if(jobs_, [&](const Job& other) {
    return other.place != nullptr &&
           std::ranges::find_first_of(other.requests, job.requests, {}, &Request::client,
                                      &Request::client) != other.requests.end();
  });
}

auto PreparationQueue::NextWaiting(bool is_long) -> std::list<Job>::iterator {
  const auto rank = [&](const Job& job) {
    return std::tuple(CountRunningOf(job), job.bytes, job.number);
  };
  auto next = jobs_.end();
  for (auto job = jobs_.begin(); job != jobs_.end(); ++job) {
    if (job->place != nullptr || job->is_long != is_long) continue;
    if (next == jobs_.end() || rank(*job) < rank(*next)) next = job;
  }
  return next;
}

PreparationQueue::Job PreparationQueue::Remove(std::list<Job>::iterator job) {
  Job removed = std::move(*job);
  jobs_.erase(job);
  backlog_ -= removed.requests.size();
  return removed;
}

void PreparationQueue::Start(Job* job) {
  job->place = free_.back();
  free_.pop_back();
  job->cancelled = std::make_shared<std::atomic<bool>>(false);
  job->turn = Deadline::AfterMs(job->turn_ms);
  job->place->Submit([this, number = job->number, work = job->work,
                      cancelled = job->cancelled]() -> BackgroundThread::Completion {
    auto result = std::make_shared<Result<OpenedDataset>>(work(*cancelled));
    return [this, number, result] { Finish(number, *result); };
  });
}

void PreparationQueue::Finish(uint64_t number, const Result<OpenedDataset>& result) {
  const auto found = std::ranges::find(jobs_, number, &Job::number);
  free_.push_back(std::exchange(found->place, nullptr));
  if (*found->cancelled && result.status().code() == StatusCode::kUnavailable) {
    found->is_long = true;  // the job waits for its next start
    found->turn_ms *= kTurnGrowth;
    return;
  }
  const Job ended = Remove(found);
  for (const Request& request : ended.requests) request.done(result);
}

void PreparationQueue::MakeWay() {
  // The number of waiting jobs of a kind less the number of its free places.
  const auto count_waiting = [&](bool is_long) {
    return std::ranges::count_if(
               jobs_,
               [&](const Job& job) { return job.place == nullptr && job.is_long == is_long; }) +
           static_cast<int64_t>(CountRunning(is_long)) -
           static_cast<int64_t>(is_long ? long_places_ : short_places_);
  };
  std::array<int64_t, 2> waiting = {count_waiting(false), count_waiting(true)};
  for (Job& job : jobs_) {
    if (job.place == nullptr || !job.turn.expired() || waiting[job.is_long] <= 0) continue;
    --waiting[job.is_long];
    if (!job.is_long && waiting[true] < 0) {
      ++waiting[true];
      job.is_long = true;
      job.turn = Deadline::AfterMs(job.turn_ms * kTurnGrowth);
    } else {
      *job.cancelled = true;
    }
  }
}

}  // namespace b4mrl
