// Keeps the physics engine from ending or hanging the process, and its warnings from being lost.
//
// MuJoCo's own error path writes a file, waits for a key and exits. InstallMujocoHandlers replaces
// that path for the process: an error outside a guard ends the process at once (the supervisor
// starts another). Inside RunGuarded an error is caught: MuJoCo's handler for the calling thread
// jumps back, as MuJoCo's own Python binding does. The mjData that was in use is then in an unknown
// state and must be deleted or reset.
#pragma once

#include <mujoco/mujoco.h>

namespace b4mrl {

// Installs the process-wide handlers; idempotent, any thread. Loading a model calls it, so a
// process that simulates cannot forget it; a worker calls it before anything else.
void InstallMujocoHandlers();

// Calls function(argument) and returns whether MuJoCo finished it without an error. `function` must
// own no object with a destructor while it calls MuJoCo, because an error skips its frame. Guards
// do not nest.
bool RunGuarded(void (*function)(void*), void* argument);
// The same for a callable without arguments, such as a lambda that captures by reference.
template <typename Function>
bool RunGuarded(Function function) {
  return RunGuarded([](void* callable) { (*static_cast<Function*>(callable))(); }, &function);
}

// The message of this thread's last error that a guard caught; "" if there was none.
const char* LastMujocoError();

// The number of warnings that `data` has counted since the last call; clears the counters.
inline int TakeWarnings(mjData* data) {
  int count = 0;
  for (mjWarningStat& warning : data->warning) {
    count += warning.number;
    warning.number = 0;
  }
  return count;
}

}  // namespace b4mrl
