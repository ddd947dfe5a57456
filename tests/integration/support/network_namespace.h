// A child process in a network namespace of its own, where nothing but loopback exists, and what
// both sides of the wall need.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <functional>
#include <set>

namespace b4mrl {

// The tcp ports on which process `process` listens.
std::set<uint16_t> ListeningPorts(pid_t process);

// Forks and runs `body` in a new namespace; what it returns is the exit code. `channel` is the
// child's end of a Unix socket, *parent_channel the parent's. Before the caller has threads.
inline constexpr int kNoNamespaces = 77;  // exit code where the system does not allow them
pid_t RunIsolated(const std::function<int(int channel)>& body, int* parent_channel);

}  // namespace b4mrl
