// Whether a process that says nothing is frozen, or merely gets no processor on a busy machine.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <optional>

namespace b4mrl {

// Processor time that all threads of a process have used so far; nullopt when there is no such
// process.
std::optional<int64_t> ProcessorTimeMs(pid_t process);

// Whether a thread of it runs, or waits for a processor or a page from the disk, rather than sleeps
// or is stopped. False when that cannot be found out.
bool WantsProcessor(pid_t process);

// A process since its last sign of life.
struct Silence {
  int64_t ms = 0;
  int64_t processor_ms = 0;  // that it used meanwhile
  bool wants_processor = false;
};

// True after `limit_ms` of silence. A process that wants to run has to have run for so long, but is
// waited for no longer than limits::kStarvedChildMs.
bool IsFrozen(const Silence& silence, int64_t limit_ms);

}  // namespace b4mrl
