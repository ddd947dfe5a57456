#include "proto/wire/listening.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>

#include <cerrno>
#include <chrono>
#include <cstddef>
#include <utility>

#include "proto/base/unique_fd.h"
#include "proto/wire/door.h"
#include "proto/wire/socket.h"

namespace b4mrl {
namespace {

constexpr std::chrono::seconds kBetweenLooks{1};
constexpr int kTcpWaitMs = 200;  // a port of this machine refuses at once

// Whether nobody listens there; false where that cannot be found out.
bool Refuses(int kind, const void* address, socklen_t length) {
  const auto* const place = static_cast<const sockaddr*>(address);
  const UniqueFd probe(socket(place->sa_family, kind | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (!probe.valid() || connect(probe.get(), place, length) == 0) return false;
  int error = errno;
  if (error == EINPROGRESS) {  // of tcp alone
    pollfd waited{probe.get(), POLLOUT, 0};
    socklen_t size = sizeof(error);
    if (poll(&waited, 1, kTcpWaitMs) <= 0) return false;
    if (getsockopt(probe.get(), SOL_SOCKET, SO_ERROR, &error, &size) != 0) return false;
  }
  return error == ECONNREFUSED || error == ENOENT;
}

bool DoorRefuses(const std::string& name) {
  sockaddr_un address;
  const socklen_t length = DoorAddress(name, &address);
  return Refuses(SOCK_SEQPACKET, &address, length);
}

bool IpcRefuses(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  path.copy(address.sun_path, sizeof(address.sun_path) - 1);
  socklen_t length = sizeof(address);
  if (path.starts_with('@')) {  // as ZeroMQ writes the name of a socket without a file
    address.sun_path[0] = '\0';
    length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + path.size());
  }
  return Refuses(SOCK_STREAM, &address, length);
}

bool TcpRefuses(const TcpAddress& place) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(place.port);
  const std::string host = place.host == "localhost" ? "127.0.0.1" : place.host;
  if (inet_pton(AF_INET, host.c_str(), &address.sin_addr) != 1) return false;
  return Refuses(SOCK_STREAM, &address, sizeof(address));
}

}  // namespace

Listening::Listening(std::string address, std::string door)
    : address_(std::move(address)), door_(std::move(door)) {}

void Listening::Look(Clock::time_point now) {
  if (now < next_look_) return;
  next_look_ = now + kBetweenLooks;
  if (!IsGone()) {
    gone_since_ = Clock::time_point::max();
  } else if (gone_since_ == Clock::time_point::max()) {
    gone_since_ = now;
  }
}

bool Listening::IsGone() const {
  if (!door_.empty() && !DoorRefuses(door_)) return false;
  // A daemon that was started again has other doors at the same address.
  if (const auto path = ParseIpcAddress(address_); path.ok()) return IpcRefuses(*path);
  const auto place = ParseTcpAddress(address_);
  return place.ok() && !door_.empty() && TcpRefuses(*place);
}

}  // namespace b4mrl
