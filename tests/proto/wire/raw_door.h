// Both ends of a local door (proto/wire/door.h) by hand, so that a test can do what neither Doors
// nor ClientDoor would. Any thread. For tests.
#pragma once

#include <sys/socket.h>
#include <sys/time.h>

#include <cstdio>
#include <string>

#include "proto/base/unique_fd.h"
#include "proto/wire/descriptors.h"
#include "proto/wire/door.h"

namespace b4mrl {

// Listens as the supervisor does. Says why on stderr and gives an invalid one if that fails.
inline UniqueFd ListenAtDoor(const std::string& name) {
  UniqueFd fd(socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  sockaddr_un address;
  const socklen_t size = DoorAddress(name, &address);
  const bool listens = bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), size) == 0 &&
                       listen(fd.get(), 1024) == 0;
  if (!listens) std::perror("cannot listen at a door");
  return listens ? std::move(fd) : UniqueFd();
}

// A connection to the door, from which reads wait for 10 s at most. Invalid if nobody listens.
inline UniqueFd ConnectToDoor(const std::string& name) {
  UniqueFd fd(socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0));
  const timeval patience{10, 0};
  setsockopt(fd.get(), SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof(patience));
  sockaddr_un address;
  const socklen_t size = DoorAddress(name, &address);
  const bool is_connected =
      connect(fd.get(), reinterpret_cast<const sockaddr*>(&address), size) == 0;
  return is_connected ? std::move(fd) : UniqueFd();
}

// Receives a greeting and the memory's descriptor, which is invalid if none comes.
inline UniqueFd ReceiveGreeting(int socket, DoorGreeting* greeting) {
  return ReceiveWithDescriptor(socket, greeting, sizeof(*greeting), 0);
}

}  // namespace b4mrl
