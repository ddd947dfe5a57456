#include "server/worker/executor.h"

#include <sys/eventfd.h>
#include <unistd.h>

#include <system_error>
#include <utility>

#include "proto/base/cores.h"
#include "server/render/painter_process.h"

namespace b4mrl {

Executor::Executor(uint32_t threads, std::span<ThreadMark> marks, std::chrono::microseconds spin,
                   std::vector<int> cores)
    : marks_(marks),
      cores_(std::move(cores)),
      queue_(threads),
      painter_queue_(1),
      socket_thread_mark_(&marks_[0]),
      completion_fd_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  socket_thread_.mark = &marks_[0];
  try {
    StartThreads(threads, spin);
  } catch (const std::system_error&) {
    StopThreads();  // else those that run would end the process
    throw;
  }
}

Executor::~Executor() {
  StopThreads();
  close(completion_fd_);
}

void Executor::StartThreads(uint32_t threads, std::chrono::microseconds spin) {
  for (uint32_t i = 1; i < threads && i + 1 < marks_.size(); ++i) {
    pool_.emplace_back(&Executor::ThreadMain, this, i,
                       [this, spinner = Spinner(spin)]() mutable { return queue_.Take(spinner); });
  }
  pool_.emplace_back(&Executor::ThreadMain, this, pool_.size() + 1,
                     [this] { return queue_.TakeInstead(); });
  painter_thread_ = std::thread(&Executor::PainterThreadMain, this);
}

void Executor::StopThreads() {
  queue_.Stop();
  painter_queue_.Stop();
  for (std::thread& thread : pool_) thread.join();
  if (painter_thread_.joinable()) painter_thread_.join();
}

void Executor::ThreadMain(uint32_t index, const TakeFunction& take) {
  WorkerThread self;
  self.mark = &marks_[index];
  const MarkedThread marked(self.mark);
  if (!cores_.empty()) PinThisThread({cores_[index % cores_.size()]});
  while (const std::optional<Piece> piece = take()) {
    ++busy_threads_;
    Execute(*piece, self);
    --busy_threads_;
  }
}

void Executor::PainterThreadMain() {
  // The painter's process inherits this thread's cores: all of the worker's, not only the first.
  if (!cores_.empty()) PinThisThread(cores_);
  PainterProcess painter;
  WorkerThread self;
  self.painter = &painter;
  Spinner spinner({});  // does not spin, since pictures take long
  while (const std::optional<Piece> piece = painter_queue_.Take(spinner)) Execute(*piece, self);
}

void Executor::Submit(RequestJob* job) {
  QueueOf(*job).Push(job, /*caller_helps=*/!job->waits_for_painter());
}

void Executor::ForgetDebts(uint32_t session) {
  queue_.Forget(session);
  painter_queue_.Forget(session);
}

void Executor::EndExpired(RequestJob* job) {
  const std::optional<Piece> rest = QueueOf(*job).TakeExpired(job);
  if (rest) Execute(*rest, socket_thread_);
}

void Executor::Execute(const Piece& piece, WorkerThread& thread) {
  auto* job = static_cast<RequestJob*>(piece.work);
  WorkQueue& queue = QueueOf(*job);
  const auto [done, us] = job->RunPiece(piece, thread);
  queue.Settle(piece, us);
  if (done < piece.count) {
    queue.PutBack(piece, done);
    // As with any_completed_ below: one of the two threads sees what the other has written.
    if (&thread != &socket_thread_) any_put_back_.store(true);
    WakeSocketThread();  // to take its share, or to leave it to the stand-in
    // Whoever looks for passed deadlines has not found these items while they were in the piece.
    if (const std::optional<Piece> rest = queue.TakeExpired(job)) Execute(*rest, thread);
  }
  if (!job->EndItems(done)) return;
  job->Complete();
  {
    std::lock_guard lock(completed_mutex_);
    completed_.push_back(job);
  }
  // BeginWait writes waiting_ and then reads any_completed_, so at least one of the two threads
  // sees what the other has written.
  any_completed_.store(true);
  WakeSocketThread();
}

void Executor::WakeSocketThread() {
  if (waiting_.exchange(false)) eventfd_write(completion_fd_, 1);
}

void Executor::RunHere(RequestJob* job) {
  const bool expired = job->items > 0 && job->deadline.expired();
  for (uint32_t done = 0; done < job->items;) {
    const Piece rest = {job, done, job->items - done, expired, 0};
    done += job->RunPiece(rest, socket_thread_).done;
  }
  job->Complete();
}

bool Executor::RunBite() {
  const std::optional<Piece> piece = queue_.TryTakeBite();
  if (piece) Execute(*piece, socket_thread_);
  return piece.has_value();
}

std::vector<RequestJob*> Executor::TakeCompleted() {
  if (!any_completed_.exchange(false)) return {};
  std::lock_guard lock(completed_mutex_);
  return std::exchange(completed_, {});
}

bool Executor::BeginWait() {
  waiting_.store(true);
  return !any_put_back_.exchange(false) && !any_completed_.load();
}

void Executor::EndWait() {
  waiting_.store(false);
  // A thread that saw waiting_ may write to the descriptor only now, which costs a needless
  // wake-up.
  eventfd_t count = 0;
  eventfd_read(completion_fd_, &count);
}

}  // namespace b4mrl
