// A folder that is looked at on a thread of its own, since a folder on a network may not answer for
// hours, and the gateway must. Thread rule: one thread; the look and other work run on the
// folder's.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>

#include "proto/base/clock.h"
#include "server/process/background_thread.h"

namespace b4mrl {

template <typename Answer>
class FolderLook {
 public:
  explicit FolderLook(std::function<Answer()> look) : state_(std::make_shared<State>()) {
    state_->look = std::move(look);
    TryRun(Look());
  }

  // What the look finds. Waits for it for 0.1 s, for the first answer 0.5 s, and not at all while
  // an earlier look has none; then it is the last answer, or Answer() before the first one.
  Answer Latest();
  // Has `work` done on the folder's thread; false while earlier work is not done.
  bool TryRun(std::function<void()> work);

 private:
  static constexpr int64_t kPatienceMs = 100;  // folders that do answer take microseconds
  // Without any answer yet, there is none to give instead; and a machine is busy where daemons
  // start.
  static constexpr int64_t kFirstPatienceMs = 500;

  struct State {
    std::function<Answer()> look;
    std::mutex mutex;
    std::condition_variable done;
    bool is_busy = false;
    std::optional<Answer> answer;  // nothing before the first one
  };

  std::function<void()> Look() const;
  // Whether all work is done, or is by then; later calls do not wait for what was late once.
  bool AwaitIdle(const Deadline& deadline);

  const std::shared_ptr<State> state_;
  bool is_late_ = false;  // the work that is under way
  BackgroundThread thread_;
};

template <typename Answer>
std::function<void()> FolderLook<Answer>::Look() const {
  return [state = state_] {
    Answer answer = state->look();
    const std::lock_guard lock(state->mutex);
    state->answer = std::move(answer);
  };
}

template <typename Answer>
bool FolderLook<Answer>::TryRun(std::function<void()> work) {
  thread_.RunCompletions();
  {
    const std::lock_guard lock(state_->mutex);
    if (state_->is_busy) return false;
    state_->is_busy = true;
  }
  is_late_ = false;
  thread_.Submit([state = state_, work = std::move(work)]() -> BackgroundThread::Completion {
    work();
    {
      const std::lock_guard lock(state->mutex);
      state->is_busy = false;
    }
    state->done.notify_all();
    return [] {};
  });
  return true;
}

template <typename Answer>
bool FolderLook<Answer>::AwaitIdle(const Deadline& deadline) {
  std::unique_lock lock(state_->mutex);
  if (is_late_ && state_->is_busy) return false;
  const auto is_idle = [this] { return !state_->is_busy; };
  is_late_ = !state_->done.wait_until(lock, deadline.at(), is_idle);
  return !is_late_;
}

template <typename Answer>
Answer FolderLook<Answer>::Latest() {
  std::unique_lock lock(state_->mutex);
  const Deadline deadline = Deadline::AfterMs(state_->answer ? kPatienceMs : kFirstPatienceMs);
  lock.unlock();
  if (AwaitIdle(deadline) && TryRun(Look())) AwaitIdle(deadline);
  lock.lock();
  return state_->answer.value_or(Answer());
}

}  // namespace b4mrl
