// The threads of an environment worker that execute jobs, and the way back for finished ones.
//
// The socket's thread submits jobs and takes completed ones; completion_fd becomes readable when
// there are any. With an idle queue it may execute a small job itself, which saves two wake-ups.
// Jobs are owned by whoever submitted them.
#pragma once

#include <atomic>
#include <mutex>
#include <thread>
#include <vector>

#include "server/request_job.h"
#include "server/shared_state.h"
#include "server/work_queue.h"

namespace b4mrl {

class Executor {
 public:
  // `marks` has a place for each thread and one for the socket's thread, and outlives this object.
  Executor(uint32_t threads, std::span<ThreadMark> marks);
  // Waits for pieces under way; jobs that were not taken are dropped.
  ~Executor();

  uint32_t threads() const { return static_cast<uint32_t>(threads_.size()); }
  void Submit(RequestJob* job) { queue_.Push(job); }
  bool idle() const { return queue_.empty() && busy_threads_.load() == 0; }
  // Socket's thread: executes all of `job` now and completes it.
  void RunHere(RequestJob* job);

  int completion_fd() const { return completion_fd_; }
  // Jobs completed since the last call; makes completion_fd unreadable.
  std::vector<RequestJob*> TakeCompleted();

  // False while some thread has been at one item for suspiciously long: the process stops its
  // heartbeat then, so that a step that never returns counts as frozen.
  bool healthy() const;

 private:
  void ThreadMain(uint32_t index);

  std::span<ThreadMark> marks_;
  WorkQueue queue_;
  std::atomic<uint32_t> busy_threads_{0};
  WorkerThread socket_thread_;
  std::mutex completed_mutex_;
  std::vector<RequestJob*> completed_;
  int completion_fd_ = -1;
  std::vector<std::thread> threads_;  // last: they use everything above
};

// Makes a deadly signal record which thread of this process raised it before it takes its course.
void InstallCrashRecorder();

}  // namespace b4mrl
