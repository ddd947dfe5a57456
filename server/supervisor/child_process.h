// One supervised process: started, watched and started again by the supervisor's only thread.
#pragma once

#include <sys/types.h>

#include <optional>
#include <span>
#include <vector>

#include "server/process/child.h"
#include "server/shared_memory/blame.h"
#include "server/shared_memory/shared_state.h"
#include "server/supervisor/process_activity.h"

namespace b4mrl {

class ChildProcess {
 public:
  // `child` is the index in the child table; every process of this child gets `options`.
  ChildProcess(uint32_t child, ChildOptions options, SharedState* shared);

  // Forks and execs. The process dies with the supervisor, has no stdin, ignores the signals that
  // begin the drain (it is announced in shared memory) and inherits its listeners and the shared
  // memory alone.
  Status Start();
  bool running() const { return process_id_ > 0; }
  pid_t process_id() const { return process_id_; }  // 0: not running
  // The time at which to Start a dead child again: at once, or later and later while the child
  // keeps dying within 250 ms of its start. A kill from outside, or for its memory, does not count.
  int64_t restart_at_ms() const { return restart_at_ms_; }

  // Reaps the process if it has ended, and says how it ended.
  std::optional<Death> Reap();
  // Takes the process for ended if it was killed and yet does not end, since its file system does
  // not answer: it does nothing more, and another one can be started.
  std::optional<Death> AbandonRemains(int64_t now_ms);
  // Kills the process when it has had no heartbeat, or one of its threads has been at one piece of
  // work, for limits::kFrozenChildMs (20 s while it starts, and anew for each session that it
  // adopts). Time in which a thread waits for a processor is not counted. A thread that stands
  // still by itself is marked as guilty. `paused`: the supervisor itself did not run for a while,
  // so silence means nothing.
  void KillIfFrozen(int64_t now_ms, bool paused);
  // Kills the process if it takes more memory than its options allow, before the system's killer
  // picks another one. ZeroMQ bounds the messages of a peer, but not the parts of one that never
  // ends.
  void KillIfLarge(int64_t now_ms);
  void Kill();

  uint32_t child() const { return child_; }
  bool ready() const { return shared_->child(child_).heartbeat.load() != beat_at_start_; }
  uint32_t deaths_before_ready() const { return deaths_before_ready_; }
  // The exit code of the last process that has ended; -1 if a signal ended it.
  int last_exit_code() const { return last_exit_code_; }

 private:
  // What is to be done when the process has ended.
  Death TakeLeave(bool was_killed);
  void ScheduleRestart(Death death);
  void RestartWatches(int64_t now_ms);
  // Whether the main loop has had no heartbeat for `limit_ms`; marks its thread as guilty if it
  // stands still by itself.
  bool FindFrozenLoop(int64_t now_ms, int64_t limit_ms);
  // Whether threads of an environment worker stand still at their work; marks them as guilty.
  bool FindStuckWork(int64_t now_ms, int64_t limit_ms);
  std::span<ThreadMark> marks() const;  // of an environment worker; empty for other children

  uint32_t child_;
  ChildOptions options_;
  SharedState* shared_;
  pid_t process_id_ = 0;
  bool killed_as_frozen_ = false;
  uint64_t beat_at_start_ = 0;
  ThreadWatch main_loop_;
  std::vector<ThreadWatch> work_;   // one for each thread of an environment worker
  bool starvation_logged_ = false;  // since the last heartbeat
  int64_t next_memory_look_ms_ = 0;
  int64_t next_remains_look_ms_ = 0;
  int remains_ = 0;  // looks in a row that found nothing else
  int64_t started_ms_ = 0;
  int64_t restart_at_ms_ = 0;
  uint32_t young_deaths_ = 0;  // deaths in a row soon after a start
  uint32_t deaths_before_ready_ = 0;
  int last_exit_code_ = -1;
};

// Ends the waiting of those dead children of this process that are not among `own`: as the first
// process of a container the supervisor inherits what its dead children had started.
void ReapStrangers(std::span<const pid_t> own);

}  // namespace b4mrl
