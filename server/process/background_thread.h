// A thread that runs slow tasks for an event loop that must not wait: the loop submits a task, and
// the completion that the task returned runs on the loop's thread.
//
// Thread rule: all members belong to the loop's thread; tasks run on the background thread, one
// after another. The destructor waits for the running task and drops the others. The caller limits
// the number of tasks.
#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <utility>
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
  // Submits `work`, whose result `done` gets on the loop's thread.
  template <typename Work, typename Done>
  void Submit(Work work, Done done) {
    Submit([work = std::move(work), done = std::move(done)]() -> Completion {
      auto result = std::make_shared<decltype(work())>(work());
      return [done, result] { done(*result); };
    });
  }
  // A descriptor that is readable while completions wait.
  int fd() const { return wake_.get(); }
  // Runs the completions of the tasks that have ended.
  void RunCompletions();

 private:
  void Loop();

  UniqueFd wake_;
  std::mutex mutex_;
  std::condition_variable submitted_;
  std::deque<Task> tasks_;
  std::vector<Completion> completions_;
  bool stopping_ = false;
  std::thread thread_;
};

}  // namespace b4mrl
