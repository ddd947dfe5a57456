// A daemon takes over the socket files of daemons that are gone, and those alone.
#include "server/supervisor/listeners.h"

#include <fcntl.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "proto/base/unique_fd.h"
#include "tests/data/temporary_folder.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

sockaddr_un AddressOf(const std::string& path) {
  sockaddr_un address = {};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path, path.c_str(), path.size() + 1);
  return address;
}

// A socket that listens on `path` and accepts nobody.
UniqueFd ListenOn(const std::string& path) {
  UniqueFd fd(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  const sockaddr_un address = AddressOf(path);
  REQUIRE(bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0);
  REQUIRE(listen(fd.get(), 0) == 0);
  return fd;
}

// Connects until nobody else can: the connections.
std::vector<UniqueFd> FillQueueOf(const std::string& path) {
  const sockaddr_un address = AddressOf(path);
  std::vector<UniqueFd> connections;
  for (int i = 0; i < 100; ++i) {
    UniqueFd fd(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
    if (connect(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0) {
      REQUIRE(errno == EAGAIN);
      return connections;
    }
    connections.push_back(std::move(fd));
  }
  FAIL("the queue takes every connection");
  return connections;
}

ServeOptions OptionsOn(const std::string& path) {
  ServeOptions options;
  options.binds = {"ipc://" + path};
  options.workers = 1;
  options.no_door = true;
  return options;
}

TEST_CASE("The socket file of a daemon that is gone is taken over") {
  const TemporaryFolder folder;
  const std::string path = folder.File("daemon");
  ListenOn(path);
  REQUIRE(std::filesystem::exists(path));
  const Listeners listeners = Take(OpenListeners(OptionsOn(path)));
  RemoveSocketFiles(listeners);
  CHECK_FALSE(std::filesystem::exists(path));
}

TEST_CASE("A socket file whose daemon ends meanwhile is taken over") {
  const TemporaryFolder folder;
  const std::string path = folder.File("daemon");
  UniqueFd child = ListenOn(path);  // of a daemon that was killed: it ends a little later
  std::thread ending([&] {
    const UniqueFd asked(accept4(child.get(), nullptr, nullptr, SOCK_CLOEXEC));
    child = UniqueFd();
  });
  const auto listeners = OpenListeners(OptionsOn(path));
  ending.join();
  RequireOk(listeners.status());
  RemoveSocketFiles(*listeners);
}

TEST_CASE("The socket file of a daemon that answers nobody is refused") {
  const TemporaryFolder folder;
  const std::string path = folder.File("daemon");
  const UniqueFd daemon = ListenOn(path);
  const std::vector<UniqueFd> waiting = FillQueueOf(path);
  CHECK(OpenListeners(OptionsOn(path)).status().code() == StatusCode::kIoError);
  CHECK(std::filesystem::exists(path));
}

TEST_CASE("A daemon's own folder ends with it, and a data folder only where it is the one in it") {
  const TemporaryFolder outside;
  const std::string own = outside.File("own");
  const bool is_inside = GENERATE(true, false);
  const std::string data = is_inside ? own + "/data" : outside.File("data");
  std::filesystem::create_directories(own);
  std::filesystem::create_directories(data + "/.cache/models");
  std::ofstream(data + "/.cache/models/file") << "compiled";
  ServeOptions options = OptionsOn(own + "/serve");
  options.own_folder = GENERATE(true, false);
  options.data_folder = data;
  RemoveSocketFiles(Take(OpenListeners(options)));
  CHECK_FALSE(std::filesystem::exists(own + "/serve"));
  CHECK(std::filesystem::exists(own) == !options.own_folder);
  CHECK(std::filesystem::exists(data + "/.cache/models/file") ==
        !(is_inside && options.own_folder));
}

TEST_CASE("A relative address is refused where the working directory is gone") {
  const UniqueFd here(open(".", O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  {
    const TemporaryFolder folder;
    REQUIRE(chdir(folder.path().c_str()) == 0);
  }
  const Status refused = OpenListeners(OptionsOn("relative")).status();
  REQUIRE(fchdir(here.get()) == 0);
  CHECK(refused.code() == StatusCode::kIoError);
  CHECK_THAT(refused.message(), Catch::Contains("relative"));
}

}  // namespace
}  // namespace b4mrl
