// A private daemon: started for one command or test, stopped with it.
//
// Start runs `b4mrl-serve` on an ipc socket in a private temporary folder, or on loopback tcp, and
// waits until it is ready. The destructor ends it with SIGTERM. If this process dies first, the
// kernel ends the daemon. Thread rule: one thread, the one that called Start; the kernel ends the
// daemon when that thread ends.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <string>
#include <vector>

#include "proto/base/status.h"

namespace b4mrl {

struct PrivateDaemonOptions {
  std::string binary;       // "": $B4MRL_SERVER, else b4mrl-serve beside the running program
  bool tcp = false;         // whether to listen on free ports of loopback instead of ipc sockets
  std::string data_folder;  // "": the daemon's default
  bool no_data = false;     // whether its data folder is an empty one, which ends with it; not tcp
  std::vector<std::string> arguments;    // further options of `b4mrl serve`
  std::vector<std::string> environment;  // "NAME=value", added to this process's variables
  int niceness = 0;                      // added to this process's niceness
  int64_t ready_deadline_ms = 20'000;    // for the daemon to become ready
};

// Niceness of a daemon that simulates while the process that started it computes. On few cores, a
// daemon without niceness takes time from that process, whose work takes longer (HyMOPO's cycle
// with rollout-lag 1 on two cores: 7.3 s with this niceness, 9.0 s without).
inline constexpr int kDaemonGivesWay = 5;

class PrivateDaemon {
 public:
  // kUnavailable if the daemon's program is not found, ends, or is not ready in time; kIoError if
  // it ends with kExitBadInput: a file or folder that it was given cannot be used.
  static Result<PrivateDaemon> Start(const PrivateDaemonOptions& options = {});
  PrivateDaemon(PrivateDaemon&& other) noexcept;
  PrivateDaemon& operator=(PrivateDaemon&& other) noexcept;
  ~PrivateDaemon();

  const std::string& endpoint() const { return endpoint_; }
  pid_t process_id() const { return process_id_; }
  // Sends SIGTERM, after `deadline_ms` SIGKILL, and waits for the daemon's end. Returns its exit
  // status as waitpid does.
  int Stop(int64_t deadline_ms = 10'000);

 private:
  PrivateDaemon() = default;
  pid_t process_id_ = -1;
  std::string endpoint_;
  std::string folder_;  // holds the ipc sockets, removed at the end; "" with tcp
};

}  // namespace b4mrl
