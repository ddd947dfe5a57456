// Whether a thread that shows no sign of life is frozen, or merely gets no processor on a busy
// machine. What others take of the machine's time must not count against it: it is judged by the
// processor time that it used itself.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <optional>

namespace b4mrl {

struct ThreadActivity {
  int64_t processor_ms = 0;  // used so far
  // It runs, or waits for a processor or a page from the disk, rather than sleeps or is stopped.
  bool wants_processor = false;
  bool stopped = false;  // by SIGSTOP or a debugger
};
// nullopt when there is no such thread.
std::optional<ThreadActivity> LookAtThread(pid_t process, pid_t thread);

// Whether any thread of it does. False when that cannot be found out.
bool WantsProcessor(pid_t process);

// A thread since its last sign of life.
struct Silence {
  int64_t ms = 0;
  int64_t processor_ms = 0;  // that it used meanwhile
  bool wants_processor = false;
  bool stopped = false;
};

enum class Verdict {
  kPatience,  // silent for less than the limit, or without a processor for so long
  kStuck,     // by itself: it sleeps, or has used as much processor time
  kHindered,  // by others for too long: stopped, or no processor for limits::kStarvedChildMs
};
// After `limit_ms` of silence.
Verdict Judge(const Silence& silence, int64_t limit_ms);

// A thread under watch: some number of its own changes as long as it gets on.
class ThreadWatch {
 public:
  // What happened until now means nothing.
  void Restart(int64_t now_ms);
  // The silence of `thread`, whose number is `sign` now; nullopt if it is short, as nearly always.
  // Processor time counts from the first call that gives a silence.
  std::optional<Silence> Look(uint64_t sign, pid_t process, pid_t thread, int64_t now_ms);

 private:
  uint64_t sign_ = 0;
  int64_t since_ms_ = 0;                 // that it has been `sign_`
  std::optional<int64_t> processor_ms_;  // of the thread when the silence was noticed
};

}  // namespace b4mrl
