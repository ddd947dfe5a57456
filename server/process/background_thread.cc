#include "server/process/background_thread.h"

#include <sys/eventfd.h>
#include <unistd.h>

#include <utility>

namespace b4mrl {

BackgroundThread::BackgroundThread()
    : wake_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)), thread_([this] { Loop(); }) {}

BackgroundThread::~BackgroundThread() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  submitted_.notify_one();
  thread_.join();
}

void BackgroundThread::Submit(Task task) {
  {
    const std::lock_guard lock(mutex_);
    tasks_.push_back(std::move(task));
  }
  submitted_.notify_one();
}

void BackgroundThread::RunCompletions() {
  uint64_t count = 0;
  while (read(wake_.get(), &count, sizeof(count)) > 0) {
  }
  std::vector<Completion> ready;
  {
    const std::lock_guard lock(mutex_);
    ready.swap(completions_);
  }
  for (const Completion& completion : ready) completion();
}

void BackgroundThread::Loop() {
  std::unique_lock lock(mutex_);
  while (true) {
    submitted_.wait(lock, [this] { return stopping_ || !tasks_.empty(); });
    if (stopping_) return;
    const Task task = std::move(tasks_.front());
    tasks_.pop_front();
    lock.unlock();
    Completion completion = task();
    lock.lock();
    completions_.push_back(std::move(completion));
    const uint64_t one = 1;
    // The write fails only when the counter is full, and then the loop wakes anyway.
    [[maybe_unused]] const ssize_t written = write(wake_.get(), &one, sizeof(one));
  }
}

}  // namespace b4mrl
