// The way to one process of the daemon: a local door where the process offers one to this machine,
// else ZeroMQ. A door that fails for good is given up in silence, and the link goes on over ZeroMQ:
// for the link's user, that is a reconnection.
//
// Thread rule: one thread.
#pragma once

#include <atomic>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "proto/base/clock.h"
#include "proto/base/status.h"
#include "proto/wire/client_door.h"
#include "proto/wire/frame.h"
#include "proto/wire/socket.h"

namespace b4mrl {

class Link {
 public:
  // A link to the process that listens on `address`. `door`: the name of its local door, or "".
  // Waits for the door until the deadline at most, or until `cancelled`, if given, turns true; for
  // ZeroMQ not at all.
  static Result<Link> Open(const Context& context, const std::string& address,
                           const std::string& door, const Deadline& deadline,
                           const std::atomic<bool>* cancelled = nullptr);

  // Never waits, but 20 ms at most for space in a door's ring (ClientDoor::Send).
  // kUnavailable when the queue towards the server is full.
  Status Send(Message message);
  // Blocks for the next message until the deadline, but at most 20 ms, after which the caller may
  // look at connections().
  std::optional<Message> Receive(const Deadline& deadline);
  // Over ZeroMQ, waits for a message, a (re)connection or the deadline. Over a door, which was
  // connected when the link was opened, it does not wait.
  void Wait(const Deadline& deadline);
  // Connections made so far. If the number has grown, requests held by an earlier peer are lost.
  uint32_t connections();
  // "door", "ipc" or "tcp".
  std::string_view transport() const;

 private:
  Link(Context context, std::string address)
      : context_(std::move(context)), address_(std::move(address)) {}
  Status OpenSocket();

  Context context_;
  std::string address_;
  std::optional<ClientDoor> door_;
  std::optional<DealerSocket> socket_;  // once there is no door
  uint32_t earlier_connections_ = 0;    // of a door that was given up
};

}  // namespace b4mrl
