// The daemon's first process: owns the listening sockets and the shared memory, starts the
// children, replaces the dead and the frozen, and turns SIGTERM into a drain. It reads no byte from
// the network and opens no model, dataset or ZeroMQ socket, so that nothing a peer sends can end
// it.
#pragma once

#include "server/process/options.h"

namespace b4mrl {

// The time at the beginning of each line of the daemon's log, as a pattern of spdlog.
inline constexpr char kLogTime[] = "%Y-%m-%d %H:%M:%S.%e ";

// Runs until SIGTERM, SIGINT, SIGQUIT or SIGHUP; returns the process's exit code. Prints "ready
// ADDRESS" on stdout, one line for each --bind, when every child reads its sockets.
int RunSupervisor(const ServeOptions& options);

}  // namespace b4mrl
