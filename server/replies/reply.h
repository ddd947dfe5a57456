// How the gateway, the environment workers and the dataset worker read requests and answer them.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <string_view>
#include <utility>

#include "proto/b4mrl.pb.h"
#include "proto/base/clock.h"
#include "proto/base/status.h"
#include "proto/wire/socket.h"

namespace b4mrl {

// Whom a reply goes to.
struct Asker {
  RoutingId peer;
  uint64_t request_id = 0;
  bool is_local = false;  // on this machine; the gateway sets it for an Open
};

// The request's own deadline, or the default, plus `grace_ms`, all counted from now. Any thread.
Deadline DeadlineOf(const pb::Request& request, int64_t grace_ms = 0);

// kUnavailable: what a daemon that is stopping answers.
Status Stopping();

// Numbers of requests that wait for the same thing.
struct WaitingCount {
  size_t of_all = 0;   // of all connections
  size_t of_peer = 0;  // of the connection that asks
};
// kLimitExceeded when as many requests wait as may, of all connections or of one. `things` names
// what waits: "Opens".
Status CheckWaiting(std::string_view things, const WaitingCount& now, const WaitingCount& most);

// Reads the requests of one process and sends its replies: whatever a message holds, it is answered
// once. Thread rule: the thread of the process's socket.
class Responder {
 public:
  // Sends a reply, or drops it when its receiver is gone.
  using SendFunction = std::function<void(const RoutingId& receiver, Message reply)>;
  // Counters in the process's line of the child table, which outlives the responder.
  struct Counters {
    std::atomic<uint64_t>& requests;
    std::atomic<uint64_t>& errors;
  };

  Responder(Counters counters, SendFunction send) : counters_(counters), send_(std::move(send)) {}

  // Reads the envelope into `request`. Returns nothing for an envelope that is malformed or of
  // another version of the protocol: it has been answered with the error.
  std::optional<Asker> Read(const IncomingMessage& incoming, pb::Request* request);

  // Sends the error, or the reply once its version, id and status are filled in. A reply that does
  // not fit an envelope is replaced by the error that says so.
  void Reply(const Asker& to, Result<pb::Reply> reply, Frame payload = Frame());
  // Sends a reply that is complete.
  void Send(const RoutingId& receiver, Message reply) { send_(receiver, std::move(reply)); }

 private:
  void ReplyError(const Asker& to, const Status& error);

  Counters counters_;
  SendFunction send_;
};

}  // namespace b4mrl
