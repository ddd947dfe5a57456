// The threads of an environment worker that execute jobs, and the way back for finished ones.
//
// The socket's thread is one of them: it submits jobs, executes small bites of the queue between
// looks at the socket, and takes completed jobs. A step costs about as much as two wake-ups of a
// thread, so every wake-up that this saves counts. Jobs are owned by whoever submitted them.
//
// Work whose single items would keep the socket's thread from its messages is left to a stand-in, a
// thread more, which works while the socket's thread finds nothing else (work_queue.h).
//
// Patient jobs (pictures, which another process draws) have a thread and a queue of their own,
// since a thread that waits 30 ms for each item would hold up everybody's steps.
#pragma once

#include <atomic>
#include <mutex>
#include <span>
#include <thread>
#include <vector>

#include "server/scheduling/work_queue.h"
#include "server/shared_memory/blame.h"
#include "server/shared_memory/shared_state.h"
#include "server/worker/request_job.h"

namespace b4mrl {

class Executor {
 public:
  // `threads` counts the socket's thread, which is the one that constructs this and calls all of
  // its methods. `marks` has a place for each thread and the stand-in, and outlives this
  // object. Thread i of the pool stays on cores[i % size], the stand-in on that of the socket's
  // thread; with none they go where the kernel puts them.
  Executor(uint32_t threads, std::span<ThreadMark> marks, std::vector<int> cores = {});
  // Waits for pieces under way; jobs that were not taken are dropped.
  ~Executor();

  void Submit(RequestJob* job);
  bool idle() const { return queue_.empty() && busy_threads_.load() == 0; }
  // Executes all of `job` now and completes it; it is not among those of TakeCompleted.
  void RunHere(RequestJob* job);
  // Ends what `job`, which was submitted, has left to do, if its deadline has passed and may end
  // it.
  void EndExpired(RequestJob* job);
  // Executes a bite of what is queued; false if nothing is.
  bool RunBite();

  // Jobs completed since the last call.
  std::vector<RequestJob*> TakeCompleted();
  // Between these two the caller may wait for completion_fd, which becomes readable when a job is
  // completed meanwhile. False: there are completed jobs already, so do not wait.
  bool BeginWait();
  void EndWait();
  int completion_fd() const { return completion_fd_; }

 private:
  using TakeFunction = std::optional<Piece> (WorkQueue::*)();
  // Thread `index`, which has that mark and core.
  void ThreadMain(uint32_t index, TakeFunction take);
  void PainterThreadMain();
  WorkQueue& QueueOf(const RequestJob& job) {
    return job.waits_for_painter() ? painter_queue_ : queue_;
  }
  // Executes a piece and hands its job on if that was its last one.
  void Execute(const Piece& piece, WorkerThread& thread);

  std::span<ThreadMark> marks_;
  std::vector<int> cores_;
  WorkQueue queue_;
  WorkQueue painter_queue_;
  std::atomic<uint32_t> busy_threads_{0};  // of the pool
  WorkerThread socket_thread_;
  MarkedThread socket_thread_mark_;
  std::mutex completed_mutex_;
  std::vector<RequestJob*> completed_;
  std::atomic<bool> any_completed_{false};
  std::atomic<bool> waiting_{false};  // the socket's thread sleeps or is about to
  int completion_fd_ = -1;
  // Last, as they use everything above.
  std::vector<std::thread> pool_;  // the last one is the stand-in
  std::thread painter_thread_;
};

}  // namespace b4mrl
