// Both ends of a local door (proto/wire/door.h) by hand, so that a test can do what neither Doors
// nor ClientDoor would. Any thread. For tests.
#pragma once

#include <sys/socket.h>
#include <sys/time.h>

#include <cstddef>
#include <cstring>
#include <span>
#include <string>

#include "proto/base/unique_fd.h"
#include "proto/wire/door.h"

namespace b4mrl {

// Listens as the supervisor does. Invalid if that fails.
inline UniqueFd ListenAtDoor(const std::string& name) {
  UniqueFd fd(socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  sockaddr_un address;
  const socklen_t size = DoorAddress(name, &address);
  const bool listens = bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), size) == 0 &&
                       listen(fd.get(), 1024) == 0;
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
  iovec bytes{greeting, sizeof(*greeting)};
  alignas(cmsghdr) char control[CMSG_SPACE(sizeof(int))] = {};
  msghdr message{};
  message.msg_iov = &bytes;
  message.msg_iovlen = 1;
  message.msg_control = control;
  message.msg_controllen = sizeof(control);
  if (recvmsg(socket, &message, MSG_CMSG_CLOEXEC) != sizeof(*greeting)) return UniqueFd();
  const cmsghdr* const header = CMSG_FIRSTHDR(&message);
  if (header == nullptr) return UniqueFd();
  int fd = -1;
  std::memcpy(&fd, CMSG_DATA(header), sizeof(fd));
  return UniqueFd(fd);
}

// Sends one datagram with up to 8 descriptors.
inline void SendWithDescriptors(int socket, const void* data, size_t size,
                                std::span<const int> fds) {
  iovec bytes{const_cast<void*>(data), size};
  alignas(cmsghdr) char control[CMSG_SPACE(8 * sizeof(int))] = {};
  msghdr message{};
  message.msg_iov = &bytes;
  message.msg_iovlen = 1;
  message.msg_control = control;
  message.msg_controllen = CMSG_SPACE(fds.size_bytes());
  cmsghdr* const header = CMSG_FIRSTHDR(&message);
  header->cmsg_level = SOL_SOCKET;
  header->cmsg_type = SCM_RIGHTS;
  header->cmsg_len = CMSG_LEN(fds.size_bytes());
  std::memcpy(CMSG_DATA(header), fds.data(), fds.size_bytes());
  sendmsg(socket, &message, MSG_DONTWAIT | MSG_NOSIGNAL);
}

}  // namespace b4mrl
