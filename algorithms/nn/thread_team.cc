#include "algorithms/nn/thread_team.h"

namespace b4mrl {

ThreadTeam::ThreadTeam(int threads) {
  try {
    for (int thread = 1; thread < threads; ++thread) {
      helpers_.emplace_back(&ThreadTeam::HelperMain, this, thread);
    }
  } catch (...) {
    End();  // a thread that was not joined would end the process
    throw;
  }
}

ThreadTeam::~ThreadTeam() { End(); }

void ThreadTeam::End() {
  {
    std::lock_guard lock(mutex_);
    stopped_ = true;
  }
  begun_.notify_all();
  for (std::thread& helper : helpers_) helper.join();
}

void ThreadTeam::Run(int pieces, void* context, Call call) {
  if (helpers_.empty() || pieces == 1) {
    for (int piece = 0; piece < pieces; ++piece) call(context, piece, 0);
    return;
  }
  std::unique_lock lock(mutex_);
  context_ = context;
  call_ = call;
  pieces_ = unfinished_ = pieces;
  next_ = 0;
  begun_.notify_all();
  Work(lock, 0);
  ended_.wait(lock, [this] { return unfinished_ == 0; });
}

void ThreadTeam::HelperMain(int thread) {
  std::unique_lock lock(mutex_);
  while (true) {
    begun_.wait(lock, [this] { return stopped_ || next_ < pieces_; });
    if (stopped_) return;
    Work(lock, thread);
  }
}

void ThreadTeam::Work(std::unique_lock<std::mutex>& lock, int thread) {
  while (next_ < pieces_) {
    const int piece = next_++;
    lock.unlock();
    call_(context_, piece, thread);
    lock.lock();
    if (--unfinished_ == 0) ended_.notify_one();
  }
}

}  // namespace b4mrl
