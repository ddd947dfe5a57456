// A process of the server to which cases send messages: through a socket, or through the local door
// of a worker. Thread rule: one thread. The Context outlives the peer.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "proto/base/status.h"
#include "proto/wire/client_door.h"
#include "proto/wire/socket.h"

namespace b4mrl::conformance {

class Peer {
 public:
  static Result<Peer> AtSocket(Context& context, const std::string& address);
  static Result<Peer> AtDoor(const std::string& name);
  // Whether a door can carry these frames: it has a place for two, and limits for their sizes.
  static bool FitsDoor(const std::vector<std::string>& frames);

  Status Send(Message message);
  // Any number of frames to a socket, of any sizes; to a door what FitsDoor.
  Status SendFrames(const std::vector<std::string>& frames);
  std::optional<Message> TryReceive();
  // Of the socket, to be waited for; null for a door.
  void* handle() const { return socket_ ? socket_->handle() : nullptr; }

 private:
  std::optional<DealerSocket> socket_;
  std::optional<ClientDoor> door_;
};

}  // namespace b4mrl::conformance
