// A thread that runs slow work for an event loop that must not wait: the loop submits a task, and
// is handed back what the task returned to run it on its own thread.
//
// Thread rule: all members belong to the loop's thread; tasks run on the other one, one after
// another. Destruction waits for the running task and drops the rest. The loop bounds what it
// submits by backlog().
#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "proto/base/unique_fd.h"

namespace b4mrl {

class BackgroundThread {
 public:
  using Completion = std::function<void()>;  // runs on the loop's thread
  using Task = std::function<Completion()>;  // runs on the background thread

  BackgroundThread();
  ~BackgroundThread();
  BackgroundThread(const BackgroundThread&) = delete;
  BackgroundThread& operator=(const BackgroundThread&) = delete;

  void Submit(Task task);
  // Tasks submitted whose completions have not run.
  size_t backlog() const { return backlog_; }
  // Readable while completions wait.
  int fd() const { return wake_.get(); }
  // Runs the completions that have arrived.
  void RunCompletions();

 private:
  void Loop();

  size_t backlog_ = 0;  // the loop's thread alone
  UniqueFd wake_;
  std::mutex mutex_;
  std::condition_variable submitted_;
  std::deque<Task> tasks_;
  std::vector<Completion> completions_;
  bool stopping_ = false;
  std::thread thread_;
};

}  // namespace b4mrl
