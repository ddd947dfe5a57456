// A queue for slow work that clients wait for: imports or derivations of datasets, or compilations
// of models. Product is the result of the work.
//
// A job starts in a place for short work, with a turn of short_ms. A job that is not done by then
// counts as long: it goes on if a place for long work is free, or while no job waits for its place.
// Otherwise it is cancelled and later starts anew in a place for long work, with a turn four times
// as long, after which the same rule holds. So a short job waits for few turns, whatever other
// clients want, and no job has to wait for the end of a long one. Of the waiting jobs, those go
// first whose clients have the fewest running jobs, of these the smallest, of these the oldest; but
// every fourth that starts is the oldest, so that no stream of small ones makes a large one wait
// for ever. Requests of one key share a job. Requests that need no answer any more leave their
// job, which is dropped with the last of them if it has not started.
//
// Thread rule: all members belong to the loop's thread; the work runs on the queue's threads.
// Destruction cancels what runs, waits for its end, and drops the rest.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <list>
#include <memory>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "proto/base/clock.h"
#include "proto/base/status.h"
#include "proto/wire/socket.h"
#include "server/process/background_thread.h"

namespace b4mrl {

template <typename Product>
class PreparationQueue {
 public:
  struct Limits {
    size_t short_places;  // for short work
    size_t long_places;
    // That the jobs of one client may take at once.
    size_t places_of_client = std::numeric_limits<size_t>::max();
  };
  // Runs on a thread of the queue; returns soon after `cancelled` turned true.
  using Work = std::function<Result<Product>(const std::atomic<bool>& cancelled)>;
  // A request for a job. Its functions run on the loop's thread.
  struct Request {
    RoutingId client;
    std::function<bool()> waits;  // false once the request needs no answer
    std::function<void(const Result<Product>&)> done;
  };

  PreparationQueue(const Limits& limits, int64_t short_ms);
  ~PreparationQueue();

  // `key` names the result: if a job of that key waits or runs, the request joins it and `work` is
  // dropped. `bytes`: how much data the work reads.
  void Submit(const std::string& key, uint64_t bytes, Work work, Request request);
  // The number of requests that wait, of all clients or of one; a running job has at least one.
  size_t Backlog() const;
  size_t BacklogOf(const RoutingId& client) const;
  // Adds descriptors of which one is readable while finished work waits for Run. Adds none while no
  // job runs, because the loop looks at all descriptors before every message.
  void AddDescriptors(std::vector<int>* fds) const;
  // Calls `done` of finished jobs and starts waiting jobs. To be called at least every 100 ms.
  void Run();

 private:
  // The turn of a job grows by this factor from one start to the next, so that the work that is
  // thrown away adds up to a third of the last turn.
  static constexpr int64_t kTurnGrowth = 4;
  // Of so many starts in places of a kind, one is the oldest job's.
  static constexpr uint64_t kStartsPerOldest = 4;

  struct Job {
    uint64_t number = 0;  // in the order of arrival
    std::string key;
    uint64_t bytes = 0;
    Work work;
    std::vector<Request> requests;
    bool is_long = false;
    BackgroundThread* place = nullptr;  // null while the job waits
    int64_t turn_ms = 0;
    Deadline turn = Deadline::AfterMs(0);
    std::shared_ptr<std::atomic<bool>> cancelled;
  };
  using Jobs = std::list<Job>;

  size_t PlacesFor(bool is_long) const {
    return is_long ? limits_.long_places : limits_.short_places;
  }
  size_t CountRunning(bool is_long) const;
  size_t CountRunningOf(const Job& job) const;
  // Whether the job waits and its clients have fewer running jobs than they may have.
  bool MayStart(const Job& job) const;
  // The job that starts next of those of a kind that may; the end of jobs_ if none may.
  typename Jobs::iterator NextWaiting(bool is_long);
  // Drops requests that need no answer any more, and jobs that have none left.
  void DropUnwanted();
  void Start(Job* job);
  void Finish(uint64_t number, const Result<Product>& result);
  void MakeWay();

  const Limits limits_;
  const int64_t short_ms_;
  uint64_t next_number_ = 0;
  std::array<uint64_t, 2> starts_ = {};  // of short and of long jobs
  Jobs jobs_;
  std::vector<BackgroundThread*> free_;
  std::vector<std::unique_ptr<BackgroundThread>> places_;
};

template <typename Product>
PreparationQueue<Product>::PreparationQueue(const Limits& limits, int64_t short_ms)
    : limits_(limits), short_ms_(short_ms) {
  for (size_t i = 0; i < limits.short_places + limits.long_places; ++i) {
    places_.push_back(std::make_unique<BackgroundThread>());
    free_.push_back(places_.back().get());
  }
}

template <typename Product>
PreparationQueue<Product>::~PreparationQueue() {
  for (const Job& job : jobs_) {
    if (job.place != nullptr) *job.cancelled = true;
  }
  places_.clear();
}

template <typename Product>
void PreparationQueue<Product>::Submit(const std::string& key, uint64_t bytes, Work work,
                                       Request request) {
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

template <typename Product>
size_t PreparationQueue<Product>::Backlog() const {
  size_t requests = 0;
  for (const Job& job : jobs_) requests += job.requests.size();
  return requests;
}

template <typename Product>
size_t PreparationQueue<Product>::BacklogOf(const RoutingId& client) const {
  size_t requests = 0;
  for (const Job& job : jobs_) {
    requests += std::ranges::count(job.requests, client, &Request::client);
  }
  return requests;
}

template <typename Product>
void PreparationQueue<Product>::AddDescriptors(std::vector<int>* fds) const {
  for (const Job& job : jobs_) {
    if (job.place != nullptr) fds->push_back(job.place->fd());
  }
}

template <typename Product>
void PreparationQueue<Product>::Run() {
  if (jobs_.empty()) return;
  for (const auto& place : places_) place->RunCompletions();
  DropUnwanted();
  MakeWay();
  for (const bool is_long : {false, true}) {
    while (!free_.empty() && CountRunning(is_long) < PlacesFor(is_long)) {
      const auto job = NextWaiting(is_long);
      if (job == jobs_.end()) break;
      Start(&*job);
    }
  }
}

template <typename Product>
void PreparationQueue<Product>::DropUnwanted() {
  for (Job& job : jobs_) {
    // The first request of a job that runs tells whose place it takes.
    const auto first = job.requests.begin() + (job.place == nullptr ? 0 : 1);
    const auto unwanted = std::remove_if(first, job.requests.end(),
                                         [](const Request& request) { return !request.waits(); });
    job.requests.erase(unwanted, job.requests.end());
  }
  jobs_.remove_if([](const Job& job) { return job.requests.empty(); });
}

template <typename Product>
size_t PreparationQueue<Product>::CountRunning(bool is_long) const {
  return std::ranges::count_if(
      jobs_, [&](const Job& job) { return job.place != nullptr && job.is_long == is_long; });
}

template <typename Product>
size_t PreparationQueue<Product>::CountRunningOf(const Job& job) const {
  // Whoever joins other clients' jobs must not use up these clients' places.
  size_t least = SIZE_MAX;
  for (const Request& request : job.requests) {
    const size_t running = std::ranges::count_if(jobs_, [&](const Job& other) {
      return other.place != nullptr && std::ranges::find(other.requests, request.client,
                                                         &Request::client) != other.requests.end();
    });
    least = std::min(least, running);
  }
  return least;
}

template <typename Product>
bool PreparationQueue<Product>::MayStart(const Job& job) const {
  return job.place == nullptr && CountRunningOf(job) < limits_.places_of_client;
}

template <typename Product>
auto PreparationQueue<Product>::NextWaiting(bool is_long) -> typename Jobs::iterator {
  const bool takes_oldest = (starts_[is_long] + 1) % kStartsPerOldest == 0;
  const auto rank = [&](const Job& job) {
    return takes_oldest ? std::tuple(size_t{0}, uint64_t{0}, job.number)
                        : std::tuple(CountRunningOf(job), job.bytes, job.number);
  };
  auto next = jobs_.end();
  for (auto job = jobs_.begin(); job != jobs_.end(); ++job) {
    if (!MayStart(*job) || job->is_long != is_long) continue;
    if (next == jobs_.end() || rank(*job) < rank(*next)) next = job;
  }
  return next;
}

template <typename Product>
void PreparationQueue<Product>::Start(Job* job) {
  ++starts_[job->is_long];
  job->place = free_.back();
  free_.pop_back();
  job->cancelled = std::make_shared<std::atomic<bool>>(false);
  job->turn = Deadline::AfterMs(job->turn_ms);
  job->place->Submit(
      [work = job->work, cancelled = job->cancelled] { return work(*cancelled); },
      [this, number = job->number](const Result<Product>& result) { Finish(number, result); });
}

template <typename Product>
void PreparationQueue<Product>::Finish(uint64_t number, const Result<Product>& result) {
  const auto found = std::ranges::find(jobs_, number, &Job::number);
  free_.push_back(std::exchange(found->place, nullptr));
  if (*found->cancelled && result.status().code() == StatusCode::kUnavailable) {
    found->is_long = true;  // the job waits for its next start
    found->turn_ms *= kTurnGrowth;
    return;
  }
  const Job ended = std::move(*found);
  jobs_.erase(found);
  for (const Request& request : ended.requests) request.done(result);
}

template <typename Product>
void PreparationQueue<Product>::MakeWay() {
  // The number of jobs of a kind that may start less the number of its free places.
  const auto count_waiting = [&](bool is_long) {
    return std::ranges::count_if(
               jobs_, [&](const Job& job) { return MayStart(job) && job.is_long == is_long; }) +
           static_cast<int64_t>(CountRunning(is_long)) - static_cast<int64_t>(PlacesFor(is_long));
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
