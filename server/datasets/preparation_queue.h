// Slow work that several clients of the dataset worker want at once: imports, or derivations.
//
// A job starts in one of the places for short work, with a turn of kShortMs. After it the job
// counts as long: it goes on where a place for long work is free, or while nobody waits for its
// own; else it is cancelled, and starts anew in such a place with a turn of four times the length,
// after which the same holds. So whoever wants little waits for seconds at most, whatever others
// want, and even a job that was slow because the machine is busy waits for nobody's end. Of the
// jobs that wait, those whose clients have the fewest running go first, of these the smallest, of
// these the oldest. Requests for the same thing share a job.
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

  // Ends soon after `cancelled` turned true.
  using Work = std::function<Result<OpenedDataset>(const std::atomic<bool>& cancelled)>;
  using Done = std::function<void(const Result<OpenedDataset>&)>;  // on the loop's thread

  PreparationQueue(size_t short_places, size_t long_places, int64_t short_ms = kShortMs);
  ~PreparationQueue();

  // `key` names what is wanted: a later request's `work` is dropped where a job has it already.
  // `bytes` is how much data the work goes through.
  void Submit(const std::string& key, const RoutingId& client, uint64_t bytes, Work work,
              Done done);
  // Requests whose `done` was not called.
  size_t backlog() const { return backlog_; }
  // Adds descriptors of which one is readable while finished work waits for Run; none while nothing
  // runs, for they are looked at before every message.
  void AddDescriptors(std::vector<int>* fds) const;
  // Calls what is done, starts what may start. At least every 100 ms.
  void Run();

 private:
  struct Job {
    uint64_t number = 0;  // in the order of arrival
    std::string key;
    uint64_t bytes = 0;
    Work work;
    std::vector<RoutingId> clients;
    std::vector<Done> done;
    bool is_long = false;
    BackgroundThread* place = nullptr;  // null while it waits
    int64_t turn_ms = 0;
    Deadline turn = Deadline::AfterMs(0);
    std::shared_ptr<std::atomic<bool>> cancelled;
  };

  size_t CountRunning(bool is_long) const;
  size_t CountRunningOf(const Job& job) const;
  // The next of those that wait; null if there is none.
  Job* NextWaiting(bool is_long);
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
