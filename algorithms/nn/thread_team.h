// Threads that share out numbered pieces of work, by which a learner uses more than one core.
//
// Any thread may take any piece, so a piece must not read what another piece writes; results then
// have equal bits for any number of threads. Thread rule: one thread at a time calls ForEach, and a
// body never calls it.
#pragma once

#include <condition_variable>
#include <mutex>
#include <thread>
#include <vector>

namespace b4mrl {

class ThreadTeam {
 public:
  // `threads`, at least 1, includes the caller of ForEach: a team of one starts no thread. Throws
  // std::system_error if the system grants fewer (algorithms/base/within_memory.h).
  explicit ThreadTeam(int threads);
  ~ThreadTeam();
  ThreadTeam(const ThreadTeam&) = delete;
  ThreadTeam& operator=(const ThreadTeam&) = delete;

  int threads() const { return static_cast<int>(helpers_.size()) + 1; }

  // Calls body(piece, thread) once for every piece in [0, pieces), `thread` in [0, threads()) being
  // the number of the calling thread. Returns when all calls have returned. Allocates nothing.
  template <typename Body>
  void ForEach(int pieces, Body body) {
    Run(pieces, &body, [](void* context, int piece, int thread) {
      (*static_cast<Body*>(context))(piece, thread);
    });
  }

 private:
  using Call = void (*)(void* context, int piece, int thread);

  void End();  // of the helpers
  void Run(int pieces, void* context, Call call);
  void HelperMain(int thread);
  // Takes and runs pieces until none is left; `lock` holds mutex_ before and after the call.
  void Work(std::unique_lock<std::mutex>& lock, int thread);

  std::mutex mutex_;
  std::condition_variable begun_, ended_;
  void* context_ = nullptr;
  Call call_ = nullptr;
  int pieces_ = 0;
  int next_ = 0;        // the first piece that no thread has taken
  int unfinished_ = 0;  // pieces whose body has not returned, taken or not
  bool stopped_ = false;
  std::vector<std::thread> helpers_;
};

}  // namespace b4mrl
