// Whether somebody listens at an address: what a client takes for the daemon's end.
#include "proto/wire/listening.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <chrono>
#include <string>

#include "proto/base/unique_fd.h"
#include "proto/wire/door.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

constexpr Clock::time_point kNever = Clock::time_point::max();

UniqueFd Listen(int family, int kind, const void* address, socklen_t length) {
  UniqueFd fd(socket(family, kind | SOCK_CLOEXEC, 0));
  REQUIRE(bind(fd.get(), static_cast<const sockaddr*>(address), length) == 0);
  REQUIRE(listen(fd.get(), 8) == 0);
  return fd;
}

UniqueFd ListenAtDoor(const std::string& name) {
  sockaddr_un address{};
  const socklen_t length = DoorAddress(name, &address);
  return Listen(AF_UNIX, SOCK_SEQPACKET, &address, length);
}

UniqueFd ListenAtPath(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  path.copy(address.sun_path, sizeof(address.sun_path) - 1);
  return Listen(AF_UNIX, SOCK_STREAM, &address, sizeof(address));
}

UniqueFd ListenAtPort(uint16_t* port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  UniqueFd fd = Listen(AF_INET, SOCK_STREAM, &address, sizeof(address));
  socklen_t length = sizeof(address);
  REQUIRE(getsockname(fd.get(), reinterpret_cast<sockaddr*>(&address), &length) == 0);
  *port = ntohs(address.sin_port);
  return fd;
}

TEST_CASE("A socket that refuses or is not there any more says since when nobody listens") {
  const TemporaryFolder folder;
  const std::string path = folder.File("socket");
  Listening listening("ipc://" + path, "");
  const Clock::time_point start = Clock::now();
  const auto at = [start](int64_t ms) { return start + std::chrono::milliseconds(ms); };
  {
    const UniqueFd listener = ListenAtPath(path);
    listening.Look(at(0));
    CHECK(listening.gone_since() == kNever);
  }
  listening.Look(at(999));  // too soon to look again
  CHECK(listening.gone_since() == kNever);
  listening.Look(at(1'000));  // the file is there, and nobody behind it
  CHECK(listening.gone_since() == at(1'000));
  REQUIRE(unlink(path.c_str()) == 0);
  listening.Look(at(2'000));
  CHECK(listening.gone_since() == at(1'000));
  const UniqueFd again = ListenAtPath(path);
  listening.Look(at(3'000));
  CHECK(listening.gone_since() == kNever);
}

TEST_CASE("A socket without a file is looked for by its name") {
  const std::string name = fmt::format("b4mrl-listening-{}", getpid());
  Listening listening("ipc://@" + name, "");
  sockaddr_un address{};
  const socklen_t length = DoorAddress(name, &address);  // doors, too, have names and no files
  {
    const UniqueFd listener = Listen(AF_UNIX, SOCK_STREAM, &address, length);
    listening.Look(Clock::now());
    CHECK(listening.gone_since() == kNever);
  }
  listening.Look(Clock::now() + std::chrono::seconds(1));
  CHECK(listening.gone_since() != kNever);
}

TEST_CASE("A tcp port that refuses tells the daemon's end where there was a door") {
  const std::string name = fmt::format("b4mrl-door-{}", getpid());
  uint16_t port = 0;
  UniqueFd listener = ListenAtPort(&port);
  UniqueFd door = ListenAtDoor(name);
  const std::string address = fmt::format("tcp://127.0.0.1:{}", port);
  const auto is_gone = [&](const std::string& by_door) {
    Listening listening(address, by_door);
    listening.Look(Clock::now());
    return listening.gone_since() != kNever;
  };
  CHECK_FALSE(is_gone(name));
  door.Reset();
  CHECK_FALSE(is_gone(name));  // started again at the same port, with other doors
  listener.Reset();
  CHECK(is_gone(name));
  CHECK_FALSE(is_gone(""));  // a tunnel, for all that is known
  door = ListenAtDoor(name);
  CHECK_FALSE(is_gone(name));
}

}  // namespace
}  // namespace b4mrl
