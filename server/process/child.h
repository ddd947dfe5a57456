// What every child process of the daemon is given and owes: its listening sockets, the shared
// memory, a heartbeat, and an ear for the drain. Built by main from the supervisor's arguments;
// lives as long as the process. Thread rule: the child's main thread, unless a method says
// otherwise.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "proto/base/status.h"
#include "proto/wire/socket.h"
#include "server/shared_memory/shared_state.h"

namespace b4mrl {

// The longest a child's main loop may wait before it beats again.
inline constexpr int64_t kBeatIntervalMs = 100;
// How often a child looks for sessions whose lease has run out, and the like.
inline constexpr int64_t kReapIntervalMs = 1'000;
// Replies that were sent before the drain have so long to leave.
inline constexpr int64_t kFlushMs = 1'000;

struct ChildOptions {
  std::string role;      // "gateway", "worker", "dataset-worker"
  uint32_t index = 0;    // of an environment worker
  uint32_t threads = 1;  // of an environment worker
  bool pin = false;      // those threads to cores
  std::string data_folder;
  std::string models_folder;  // "" for the default
  std::vector<ListeningEndpoint> endpoints;
  // Where clients reach each environment worker and the dataset worker, in the form of pb::Port.
  struct Port {
    uint32_t tcp = 0;
    std::string ipc;
  };
  std::vector<Port> worker_ports;
  Port dataset_port;
  // Where the gateway reaches them.
  std::vector<std::string> worker_addresses;
  std::string dataset_address;
};

class ChildContext {
 public:
  ChildContext(ChildOptions options, SharedState shared);

  const ChildOptions& options() const { return options_; }
  SharedState& shared() { return shared_; }
  // This process's line of the child table. Its counters may be bumped by any thread.
  ChildRecord& record() { return shared_.child(child_index_); }

  // Tells the supervisor that the main loop goes round. The first call also reports readiness, so
  // it comes after the sockets are open. At least every 200 ms; silence for limits::kFrozenChildMs
  // gets the process replaced.
  void Beat() { ++record().heartbeat; }
  // True once the daemon stops: finish what is under way, answer what is new with kUnavailable, let
  // replies leave (RouterSocket::LingerOnClose) and return.
  bool draining() const { return shared_.header().draining.load(std::memory_order_relaxed); }

 private:
  ChildOptions options_;
  SharedState shared_;
  uint32_t child_index_;
};

// The roles' main functions. They return OK after a drain; another status ends the process with a
// message and, if it came before the first Beat, the whole daemon.
Status RunGateway(ChildContext& context);
Status RunWorker(ChildContext& context);

}  // namespace b4mrl
