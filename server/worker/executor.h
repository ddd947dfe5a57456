// The threads of an environment worker that execute jobs, and the way back for finished jobs.
//
// The socket's thread is one of them: it submits jobs, executes small bites of the queue between
// two looks at the socket, and takes completed jobs. A step costs about as much as waking a thread
// twice, so work that the socket's thread does itself saves time. The caller that submits a job
// owns it.
//
// Items that would keep the socket's thread from its messages for too long are left to a stand-in,
// one thread more, which works while the socket's thread finds no shorter items (work_queue.h).
//
// Jobs that wait for the painter (pictures, which another process draws) have a thread and a queue
// of their own, since a thread that waits 30 ms for each item would hold up the steps of all
// sessions.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
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
  // `threads` includes the socket's thread, which constructs the executor and calls all of its
  // methods. `marks` has a place for each thread and the stand-in, and outlives the executor.
  // Thread i of the pool stays on cores[i % size], the stand-in on the core of the socket's thread;
  // if `cores` is empty, the kernel chooses. `spin`: the longest spin of a thread of the pool.
  // std::system_error if the system grants fewer threads.
  Executor(uint32_t threads, std::span<ThreadMark> marks, std::chrono::microseconds spin = {},
           std::vector<int> cores = {});
  // Waits for pieces that are being executed; the rest of the queue is dropped.
  ~Executor();

  // Threads that may step environments at once: the socket's, the pool's and the stand-in.
  uint32_t thread_count() const { return 1 + static_cast<uint32_t>(pool_.size()); }
  void Submit(RequestJob* job);
  // A new session has the index `session`, whose last one's debts of time are cancelled.
  void ForgetDebts(uint32_t session);
  bool idle() const { return queue_.empty() && busy_threads_.load() == 0; }
  // Executes all of `job` now and completes it; TakeCompleted does not return it.
  void RunHere(RequestJob* job);
  // Ends what is left of `job`, which was submitted, if its deadline has passed and may end it.
  void EndExpired(RequestJob* job);
  // Executes a bite of the queue; false if there is none.
  bool RunBite();

  // Whether TakeCompleted would return a job.
  bool has_completed() const { return any_completed_.load(std::memory_order_relaxed); }
  // Jobs completed since the last call.
  std::vector<RequestJob*> TakeCompleted();
  // Between BeginWait and EndWait the caller may wait for completion_fd, which becomes readable
  // when a job is completed or another thread puts items back. BeginWait returns false when there
  // are completed jobs already, or items were put back since the last BeginWait.
  bool BeginWait();
  void EndWait();
  int completion_fd() const { return completion_fd_; }

 private:
  using TakeFunction = std::function<std::optional<Piece>()>;
  void StartThreads(uint32_t threads, std::chrono::microseconds spin);
  void StopThreads();
  // The main function of thread `index`, which has the mark and core of that index.
  void ThreadMain(uint32_t index, const TakeFunction& take);
  void PainterThreadMain();
  WorkQueue& QueueOf(const RequestJob& job) {
    return job.waits_for_painter() ? painter_queue_ : queue_;
  }
  // Executes a piece, or its beginning where it takes too long; after a job's last item, completes
  // the job and hands it back.
  void Execute(const Piece& piece, WorkerThread& thread);
  // Ends the wait of the socket's thread, if it waits.
  void WakeSocketThread();

  std::span<ThreadMark> marks_;
  std::vector<int> cores_;
  WorkQueue queue_;
  WorkQueue painter_queue_;
  std::atomic<uint32_t> busy_threads_{0};  // threads of the pool that execute a piece
  WorkerThread socket_thread_;
  MarkedThread socket_thread_mark_;
  std::mutex completed_mutex_;
  std::vector<RequestJob*> completed_;
  std::atomic<bool> any_completed_{false};
  std::atomic<bool> any_put_back_{false};  // by another thread than the socket's
  std::atomic<bool> waiting_{false};       // the socket's thread sleeps or is about to
  int completion_fd_ = -1;
  // Last: these threads use all members above.
  std::vector<std::thread> pool_;  // the last one is the stand-in
  std::thread painter_thread_;
};

}  // namespace b4mrl
