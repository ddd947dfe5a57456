// One supervised process: started, watched and started again by the supervisor's only thread.
#pragma once

#include <sys/types.h>

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "server/process/child.h"
#include "server/shared_memory/blame.h"
#include "server/shared_memory/shared_state.h"
#include "server/supervisor/process_activity.h"

namespace b4mrl {

class ChildProcess {
 public:
  // `child` is the index in the child table; `options` goes to every generation.
  ChildProcess(uint32_t child, ChildOptions options, SharedState* shared);

  // Forks and execs. The process dies with the supervisor, has no stdin, ignores SIGINT, SIGTERM
  // and SIGHUP (the drain is announced in shared memory) and inherits its listeners and the shared
  // memory alone.
  Status Start();
  bool running() const { return process_id_ > 0; }
  // The time of the next Start of a dead child: at once, but backing off while it dies young again
  // and again. One that somebody else kills has not died of youth.
  int64_t restart_at_ms() const { return restart_at_ms_; }

  // Reaps the process if it has ended; says how.
  std::optional<Death> Reap();
  // Kills it if its heartbeat is silent or a thread at one piece of work for too long, and not for
  // want of a processor; the thread is blamed if it was its own doing. `paused` says that the
  // supervisor itself was not running for a while, so that silence means nothing.
  void KillIfFrozen(int64_t now_ms, bool paused);
  void Kill();

  uint32_t child() const { return child_; }
  bool ready() const { return shared_->child(child_).heartbeat.load() != beat_at_start_; }
  uint32_t deaths_before_ready() const { return deaths_before_ready_; }
  // The exit code of a process that ended before it was ever ready; -1 if a signal ended it.
  int last_exit_code() const { return last_exit_code_; }

 private:
  void ScheduleRestart(Death death);
  void RestartWatches(int64_t now_ms);
  // Whether the main loop goes round too slowly; accuses what its thread executes if that is why.
  bool MainLoopIsFrozen(int64_t now_ms, int64_t limit_ms);
  // Whether threads of an environment worker stand still at what they execute; accuses them.
  bool WorkIsStuck(int64_t now_ms, int64_t limit_ms);
  std::span<ThreadMark> marks() const;  // none but an environment worker's

  uint32_t child_;
  ChildOptions options_;
  SharedState* shared_;
  pid_t process_id_ = 0;
  bool killed_as_frozen_ = false;
  uint64_t beat_at_start_ = 0;
  ThreadWatch main_loop_;
  std::vector<ThreadWatch> work_;   // by thread of an environment worker
  bool starvation_logged_ = false;  // since it last had no reason
  int64_t started_ms_ = 0;
  int64_t restart_at_ms_ = 0;
  uint32_t young_deaths_ = 0;  // in a row
  uint32_t deaths_before_ready_ = 0;
  int last_exit_code_ = -1;
};

}  // namespace b4mrl
