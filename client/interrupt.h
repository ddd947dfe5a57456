// Ctrl-C for commands: a flag that their loops check and that ends the waits of a Client
// (`cancelled` of client.h), so that an interrupted command ends in order, without half-written
// files, and says so.
//
// The first SIGINT or SIGTERM sets the flag; a second SIGINT ends the process at once, a second
// SIGTERM does nothing more. A signal that was ignored when the process began (nohup, a script's
// job in the background) stays ignored.
#pragma once

#include <atomic>

#include "proto/base/status.h"

namespace b4mrl {

// Installs the signal handlers. Call it once, at the beginning of main.
void CatchInterrupts();

// The flag; it stays false if no handlers are installed. Any thread may read it.
const std::atomic<bool>& Interrupted();

// OK, or kUnavailable once the flag is set: for work that asks between its pieces whether to go on.
Status UnlessInterrupted();

// A command's exit code after an interrupt: 128 + the signal's number, as in shells.
int InterruptExitCode();

}  // namespace b4mrl
