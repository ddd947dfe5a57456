// Whether a thread that shows no sign of life is frozen, or merely gets no processor on a busy
// machine. A thread is judged by the processor time that it used itself, so that the time of other
// programs does not count against it. Thread rule: the supervisor's only thread.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <optional>

namespace b4mrl {

struct ThreadActivity {
  int64_t processor_ms = 0;  // processor time that the thread has used so far
  // The thread runs, or waits for a processor or for a page from the disk; it neither sleeps nor is
  // it stopped.
  bool wants_processor = false;
  bool stopped = false;  // by SIGSTOP or a debugger
  bool ended = false;
};
// nullopt when there is no such thread.
std::optional<ThreadActivity> LookAtThread(pid_t process, pid_t thread);

// Whether the process has ended but for threads that the system cannot end, as their file system
// does not answer. True for a moment, too, of one that is not waited for yet.
bool HasOnlyRemains(pid_t process);

// Whether any thread of the process wants a processor. False when that cannot be found out.
bool WantsProcessor(pid_t process);

// Memory of the process's own, without files and what it shares; 0 if that cannot be found out.
uint64_t OwnMemoryBytes(pid_t process);

// A thread since its last sign of life.
struct Silence {
  int64_t ms = 0;            // since the last sign of life
  int64_t processor_ms = 0;  // processor time that the thread used meanwhile
  bool wants_processor = false;
  bool stopped = false;
};

enum class Verdict {
  kPatience,  // wait on: silent for less than the limit, or for want of a processor
  kStuck,     // stands still by itself: it sleeps, or used processor time up to the limit
  kHindered,  // for too long by others: stopped, or no processor for limits::kStarvedChildMs
};
// The verdict on a thread that may be silent for `limit_ms`.
Verdict Judge(const Silence& silence, int64_t limit_ms);

// Watches one thread by a number, its sign of life, that changes as long as the thread gets on.
class ThreadWatch {
 public:
  // Starts the watch anew: silence before `now_ms` is not counted.
  void Restart(int64_t now_ms);
  // The silence of `thread`, whose number is `sign` now; nullopt if it is short, as nearly always.
  // Processor time counts from the first call that gives a silence.
  std::optional<Silence> Look(uint64_t sign, pid_t process, pid_t thread, int64_t now_ms);

 private:
  uint64_t sign_ = 0;
  int64_t since_ms_ = 0;                 // the time when the number became `sign_`
  std::optional<int64_t> processor_ms_;  // the thread's, when the silence was noticed
};

}  // namespace b4mrl
