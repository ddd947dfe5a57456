#include "server/supervisor/service_manager.h"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <catch2/catch.hpp>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <string>

#include "proto/base/unique_fd.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

// Listens at `name`, as it stands in $NOTIFY_SOCKET.
UniqueFd ListenAt(std::string name) {
  UniqueFd fd(socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (name.front() == '@') name.front() = '\0';
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  REQUIRE(name.size() < sizeof(address.sun_path));
  std::memcpy(address.sun_path, name.data(), name.size());
  const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size());
  REQUIRE(bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), size) == 0);
  return fd;
}

// What has come; "" if nothing has.
std::string ReceivedBy(const UniqueFd& fd) {
  std::array<char, 100> text{};
  const ssize_t size = recv(fd.get(), text.data(), text.size(), MSG_DONTWAIT);
  return size < 0 ? "" : std::string(text.data(), static_cast<size_t>(size));
}

TEST_CASE("systemd is told the daemon's state at the socket that it names") {
  const TemporaryFolder folder;
  for (const std::string& name : {folder.File("notify"), "@b4mrl-test" + folder.path()}) {
    const UniqueFd manager = ListenAt(name);
    setenv("NOTIFY_SOCKET", name.c_str(), 1);
    CHECK(TellServiceManager("READY=1"));
    CHECK(ReceivedBy(manager) == "READY=1");
    CHECK(ReceivedBy(manager) == "");
    // The variables of a service that has started this process are none of its business.
    setenv("SYSTEMD_EXEC_PID", std::to_string(getppid()).c_str(), 1);
    CHECK(TellServiceManager("READY=1"));
    CHECK(ReceivedBy(manager) == "");
    setenv("SYSTEMD_EXEC_PID", std::to_string(getpid()).c_str(), 1);
    CHECK(TellServiceManager("STOPPING=1"));
    CHECK(ReceivedBy(manager) == "STOPPING=1");
    unsetenv("SYSTEMD_EXEC_PID");
  }
  for (const std::string& name : {std::string(200, 'x'), folder.File("nobody")}) {
    setenv("NOTIFY_SOCKET", name.c_str(), 1);
    CHECK_FALSE(TellServiceManager("READY=1"));
  }
  setenv("NOTIFY_SOCKET", "", 1);
  CHECK(TellServiceManager("READY=1"));
  unsetenv("NOTIFY_SOCKET");
  CHECK(TellServiceManager("READY=1"));
}

}  // namespace
}  // namespace b4mrl
