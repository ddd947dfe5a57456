// Ctrl-C for commands: a flag that their loops look at and that ends the waits of a Client which
// was given it (client.h), so that a command leaves in order, without half-written files, and says
// so.
//
// The first SIGINT or SIGTERM sets the flag; the second ends the process at once. A signal that was
// ignored when the process began (nohup, a script's job in the background) stays ignored.
#pragma once

#include <atomic>

namespace b4mrl {

// Installs the handlers. Call it once, first of all.
void CatchInterrupts();

// Any thread, also where nothing was installed: then it stays false.
const std::atomic<bool>& Interrupted();

// What a command exits with after an interrupt: 128 + the signal's number, as a shell has it.
int InterruptExitCode();

}  // namespace b4mrl
