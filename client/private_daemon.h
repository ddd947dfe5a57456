// A daemon of one's own: started for one command or test, stopped with it.
//
// Runs `b4mrl-serve` on an ipc socket in a private temporary folder, or on loopback tcp, waits
// until it is ready, and ends it with SIGTERM when the object goes. If this process dies first, the
// kernel ends the daemon. Thread rule: one thread, the one that started it (the kernel ties the
// daemon to it).
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <string>
#include <vector>

#include "proto/base/status.h"

namespace b4mrl {

struct PrivateDaemonOptions {
  std::string binary;       // "": $B4MRL_SERVER, else b4mrl-serve beside the running program
  bool tcp = false;         // loopback with free ports instead of ipc
  std::string data_folder;  // "": the daemon's default
  std::vector<std::string> arguments;    // further ones
  std::vector<std::string> environment;  // "NAME=value", on top of this process's
  int niceness = 0;                      // on top of this process's
  int64_t ready_deadline_ms = 20'000;
};

// For a daemon that simulates while the process that started it computes: without it the two get
// equal turns where cores are short, and the one that everything waits for is late (HyMOPO's cycle
// with rollout-lag 1: 7.3 s instead of 9.0 s on two cores).
inline constexpr int kDaemonGivesWay = 5;

class PrivateDaemon {
 public:
  // kUnavailable when the program is not found, ends, or is not ready in time.
  static Result<PrivateDaemon> Start(const PrivateDaemonOptions& options = {});
  PrivateDaemon(PrivateDaemon&& other) noexcept;
  PrivateDaemon& operator=(PrivateDaemon&& other) noexcept;
  ~PrivateDaemon();

  const std::string& endpoint() const { return endpoint_; }
  pid_t process_id() const { return process_id_; }
  // Sends SIGTERM and waits; the daemon's exit status as waitpid gives it. Kills it after
  // `deadline_ms`.
  int Stop(int64_t deadline_ms = 10'000);

 private:
  PrivateDaemon() = default;
  pid_t process_id_ = -1;
  std::string endpoint_;
  std::string folder_;  // of the ipc sockets, removed at the end; "" with tcp
};

}  // namespace b4mrl
