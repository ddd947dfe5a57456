// A few threads that share out numbered pieces of work: how a learner uses more than one core.
//
// Which thread does which piece is chance, so a piece may depend on nothing that another one
// writes; then results are the same bits for any number of threads. Thread rule: one thread at a
// time calls ForEach, and no body does.
#pragma once

#include <condition_variable>
#include <mutex>
#include <thread>
#include <vector>

namespace b4mrl {

class ThreadTeam {
 public:
  // The caller of ForEach is one of `threads`, which is at least 1: a team of one starts none.
  explicit ThreadTeam(int threads);
  ~ThreadTeam();
  ThreadTeam(const ThreadTeam&) = delete;
  ThreadTeam& operator=(const ThreadTeam&) = delete;

  int threads() const { return static_cast<int>(helpers_.size()) + 1; }

  // body(piece, thread) for every piece in [0, pieces), by the thread of that number in [0,
  // threads()); returns when all are done. Allocates nothing.
  template <typename Body>
  void ForEach(int pieces, Body body) {
    Run(pieces, &body, [](void* context, int piece, int thread) {
      (*static_cast<Body*>(context))(piece, thread);
    });
  }

 private:
  using Call = void (*)(void* context, int piece, int thread);

  void Run(int pieces, void* context, Call call);
  void HelperMain(int thread);
  // Takes pieces until there are none; `lock` holds mutex_ before and after.
  void Work(std::unique_lock<std::mutex>& lock, int thread);

  std::mutex mutex_;
  std::condition_variable begun_, ended_;
  void* context_ = nullptr;
  Call call_ = nullptr;
  int pieces_ = 0;
  int next_ = 0;        // first piece that nobody has taken
  int unfinished_ = 0;  // taken or not
  bool stopped_ = false;
  std::vector<std::thread> helpers_;
};

}  // namespace b4mrl
