// A queue for slow work of the dataset worker's clients: of imports, or of derivations.
//
// A job starts in a place for short work, with a turn of kShortMs. A job that is not done by then
// counts as long: it goes on if a place for long work is free, or while no job waits for its place.
// Otherwise it is cancelled and later starts anew in a place for long work, with a turn four times
// as long, after which the same rule holds. So a short job waits for seconds at most, whatever
// other clients want, and no job has to wait for the end of a long one. Of the waiting jobs, those
// go first whose clients have the fewest running jobs, of these the smallest, of these the oldest.
// Requests for the same dataset share a job. A job is dropped when its turn comes and none of its
// requests waits for it any more.
//
// Thread rule: all members belong to the loop's thread; the work runs on the queue's threads.
// Destruction cancels what runs, waits for its end, and drops the rest.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <list>
#include <memory>
#include <string>
#include <vector>

#include "proto/base/clock.h"
#include "proto/wire/socket.h"
#include "server/datasets/dataset_store.h"
#include "server/process/background_thread.h"

namespace b4mrl {

class PreparationQueue {
 public:
  static constexpr int64_t kShortMs = 2000;

  // Runs on a thread of the queue; returns soon after `cancelled` turned true.
  using Work = std::function<Result<OpenedDataset>(const std::atomic<bool>& cancelled)>;
  // A request for a job. Its functions run on the loop's thread.
  struct Request {
    RoutingId client;
    std::function<bool()> waits;  // false once the request needs no answer
    std::function<void(const Result<OpenedDataset>&)> done;
  };

  PreparationQueue(size_t short_places, size_t long_places, int64_t short_ms = kShortMs);
  ~PreparationQueue();

  // `key` names the result: if a job of that key waits or runs, the request joins it and `work` is
  // dropped. `bytes`: how much data the work reads.
  void Submit(const std::string& key, uint64_t bytes, Work work, Request request);
  // The number of requests whose jobs have neither ended nor been dropped: of all clients, of one.
  size_t backlog() const { return backlog_; }
  size_t BacklogOf(const RoutingId& client) const;
  // Adds descriptors of which one is readable while finished work waits for Run. Adds none while no
  // job runs, because the loop looks at all descriptors before every message.
  void AddDescriptors(std::vector<int>* fds) const;
  // Calls `done` of finished jobs and starts waiting jobs. To be called at least every 100 ms.
  void Run();

 private:
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

  size_t CountRunning(bool is_long) const;
  size_t CountRunningOf(const Job& job) const;
  // The waiting job that goes first; the end of jobs_ if there is none.
  std::list<Job>::iterator NextWaiting(bool is_long);
  // Takes the job out of the queue.
  Job Remove(std::list<Job>::iterator job);
  void Start(Job* job);
  void Finish(uint64_t number, const Result<OpenedDataset>& result);
  void MakeWay();

  size_t short_places_, long_places_;
  int64_t short_ms_;
  size_t backlog_ = 0;
  uint64_t next_number_ = 0;
  std::list<Job> jobs_;
  std::vector<BackgroundThread*> free_;
  std::vector<std::unique_ptr<BackgroundThread>> places_;
};

}  // namespace b4mrl
