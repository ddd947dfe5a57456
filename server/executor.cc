#include "server/executor.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>

namespace b4mrl {
namespace {

// An item takes microseconds. The heartbeat pauses after this; limits::kFrozenChildMs of silence
// later the process is replaced.
constexpr int64_t kSlowItemMs = 200;

constexpr std::array<int, 5> kDeadlySignals = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};
std::array<struct sigaction, kDeadlySignals.size()> previous_actions;
thread_local ThreadMark* thread_mark = nullptr;

// Async-signal-safe: stores to shared memory and a system call.
void RecordCrash(int signal) {
  if (thread_mark != nullptr) thread_mark->crashed.store(1);
  for (size_t i = 0; i < kDeadlySignals.size(); ++i) {
    // Returning repeats the faulting instruction (abort() raises again) under the previous action.
    if (kDeadlySignals[i] == signal) sigaction(signal, &previous_actions[i], nullptr);
  }
}

}  // namespace

void InstallCrashRecorder() {
  for (size_t i = 0; i < kDeadlySignals.size(); ++i) {
    struct sigaction action {};
    action.sa_handler = RecordCrash;
    action.sa_flags = SA_NODEFER;
    sigaction(kDeadlySignals[i], &action, &previous_actions[i]);
  }
}

Executor::Executor(uint32_t threads, std::span<ThreadMark> marks)
    : marks_(marks), completion_fd_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  socket_thread_.mark = thread_mark = &marks_[0];
  for (uint32_t i = 0; i < threads && i + 1 < marks.size(); ++i) {
    threads_.emplace_back(&Executor::ThreadMain, this, i);
  }
}

Executor::~Executor() {
  queue_.Stop();
  for (std::thread& thread : threads_) thread.join();
  close(completion_fd_);
}

void Executor::ThreadMain(uint32_t index) {
  WorkerThread self;
  self.mark = thread_mark = &marks_[index + 1];
  while (const std::optional<Piece> piece = queue_.Take()) {
    ++busy_threads_;
    auto* job = static_cast<RequestJob*>(piece->work);
    const bool last = job->RunPiece(*piece, self);
    if (last) job->Complete();
    --busy_threads_;
    if (!last) continue;
    {
      std::lock_guard lock(completed_mutex_);
      completed_.push_back(job);
    }
    eventfd_write(completion_fd_, 1);
  }
}

void Executor::RunHere(RequestJob* job) {
  if (job->items > 0) {
    const bool expired = job->deadline.expired();
    job->RunPiece({job, 0, job->items, expired}, socket_thread_);
  }
  job->Complete();
}

std::vector<RequestJob*> Executor::TakeCompleted() {
  eventfd_t count = 0;
  eventfd_read(completion_fd_, &count);
  std::lock_guard lock(completed_mutex_);
  return std::exchange(completed_, {});
}

bool Executor::healthy() const {
  const int64_t now = MonotonicMs();
  return std::none_of(
      marks_.begin(), marks_.begin() + threads() + 1, [now](const ThreadMark& mark) {
        return mark.kind.load() != MarkKind::kIdle && now - mark.since_ms.load() > kSlowItemMs;
      });
}

}  // namespace b4mrl
