// The context of every child process of the daemon: its options with the listening sockets, the
// shared memory, its heartbeat and the sign of the drain. Built by main from the supervisor's
// arguments; lives as long as the process. Thread rule: the child's main thread, unless a method
// says otherwise.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "proto/base/status.h"
#include "proto/wire/socket.h"
#include "server/shared_memory/shared_state.h"

namespace b4mrl {

// The longest time that a child's main loop may wait before its next heartbeat.
inline constexpr int64_t kBeatIntervalMs = 100;
// Interval of a child's periodic checks, such as that for sessions whose lease has run out.
inline constexpr int64_t kReapIntervalMs = 1'000;
// Time in which the replies sent before the drain may leave the process.
inline constexpr int64_t kFlushMs = 1'000;

// What the user tells the supervisor and the supervisor its children.
struct CommonOptions {
  uint32_t threads = 0;       // of each environment worker
  bool pin = false;           // an environment worker keeps each thread on one core
  uint32_t memory_mib = 0;    // above which the supervisor replaces a process
  uint32_t cache_mib = 0;     // of disk, that the caches of all datasets may take
  std::string data_folder;    // exists
  std::string models_folder;  // exists, or "" for the default
  std::string suites_folder;  // exists, or "": the project's suites alone
  // The longest spin of a worker's threads and of its doors' clients; 0: none.
  std::optional<uint32_t> spin_us;
};

struct ChildOptions : CommonOptions {
  std::string role;    // "gateway", "worker", "dataset-worker"
  uint32_t index = 0;  // of an environment worker
  std::vector<ListeningEndpoint> endpoints;
  int door_listener = -1;  // of an environment worker; -1: it has no local door
  // Where clients reach each environment worker and the dataset worker, in the form of pb::Port.
  struct Port {
    uint32_t tcp = 0;
    std::string ipc;
    std::string door;
  };
  std::vector<Port> worker_ports;
  Port dataset_port;
  // Where the gateway reaches each environment worker and the dataset worker.
  std::vector<std::string> worker_addresses;
  std::string dataset_address;
};

class ChildContext {
 public:
  ChildContext(ChildOptions options, SharedState shared);

  const ChildOptions& options() const { return options_; }
  // The memory that --memory allows this process; server/process/memory_shares.h divides it.
  uint64_t memory_bytes() const { return uint64_t{options_.memory_mib} << 20; }
  SharedState& shared() { return shared_; }
  // This process's line of the child table. Any thread may increase its counters.
  ChildRecord& record() { return shared_.child(child_index_); }

  // The heartbeat: tells the supervisor that the main loop goes round. To be called at least every
  // 200 ms; the process is replaced after limits::kFrozenChildMs without a heartbeat. The first
  // call reports that the process is ready, so it comes after the sockets are open.
  void Beat() { ++record().heartbeat; }
  // True once the daemon stops. The process then finishes the requests under way, answers new
  // requests with kUnavailable, lets replies leave (RouterSocket::LingerOnClose) and returns.
  bool draining() const { return shared_.header().draining.load(std::memory_order_relaxed); }

 private:
  ChildOptions options_;
  SharedState shared_;
  uint32_t child_index_;
};

// The main functions of the roles "gateway" and "worker". They return OK after a drain. Another
// status ends the process with a message and, before the first Beat, the whole daemon.
Status RunGateway(ChildContext& context);
Status RunWorker(ChildContext& context);

}  // namespace b4mrl
