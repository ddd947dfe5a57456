#include "server/supervisor/service_manager.h"

#include <sys/socket.h>
#include <sys/time.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <string>

#include "proto/base/unique_fd.h"

namespace b4mrl {

bool TellServiceManager(std::string_view state) {
  const char* const set = std::getenv("NOTIFY_SOCKET");
  const char* const started = std::getenv("SYSTEMD_EXEC_PID");
  std::string path = set == nullptr ? "" : set;
  if (path.empty() || (started != nullptr && started != std::to_string(getpid()))) return true;
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.size() >= sizeof(address.sun_path)) return false;
  if (path.front() == '@') path.front() = '\0';  // an abstract name
  std::memcpy(address.sun_path, path.data(), path.size());
  const UniqueFd fd(socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  const timeval patience{.tv_sec = 1, .tv_usec = 0};
  setsockopt(fd.get(), SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof(patience));
  const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + path.size());
  return sendto(fd.get(), state.data(), state.size(), MSG_NOSIGNAL,
                reinterpret_cast<const sockaddr*>(&address), size) >= 0;
}

}  // namespace b4mrl
