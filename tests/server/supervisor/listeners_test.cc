// A daemon takes over the socket files of daemons that are gone, and those alone.
#include "server/supervisor/listeners.h"

#include <fcntl.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <atomic>
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
#include "tests/environment_variable.h"
#include "tests/loopback.h"
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

TEST_CASE("A file that is no socket is told from a daemon's, and stays") {
  const TemporaryFolder folder;
  const std::string path = folder.File("notes");
  WriteBytes(path, "mine");
  const Status refused = OpenListeners(OptionsOn(path)).status();
  CHECK(refused.code() == StatusCode::kIoError);
  CHECK_THAT(refused.message(), Catch::Contains(path) && Catch::Contains("that is no socket"));
  CHECK(ReadBytes(path) == "mine");
}

TEST_CASE("A worker's port in use is explained by the gateway's, which the user has named") {
  // Of a port that is taken, the one before must be free for the gateway, which the system cannot
  // be asked for.
  UniqueFd taken;
  for (int attempt = 0; attempt < 100 && !taken.valid(); ++attempt) {
    UniqueFd drawn = ListenOnLoopback(0);
    REQUIRE(drawn.valid());
    const auto before = static_cast<uint16_t>(PortOf(drawn) - 1);
    if (ListenOnLoopback(before).valid()) taken = std::move(drawn);
  }
  REQUIRE(taken.valid());
  ServeOptions options;
  options.workers = 1;
  options.no_door = true;
  const auto refused = [&](int port) {
    options.binds = {"tcp://127.0.0.1:" + std::to_string(port)};
    const Status status = OpenListeners(options).status();
    CHECK(status.code() == StatusCode::kIoError);
    CHECK_THAT(status.message(),
               Catch::Contains("tcp://127.0.0.1:" + std::to_string(PortOf(taken)) + ": Address"));
    return status.message();
  };
  const int gateway = PortOf(taken) - 1;
  CHECK_THAT(refused(gateway), Catch::Contains("a daemon at port " + std::to_string(gateway) +
                                               " also takes the ports after it"));
  CHECK_THAT(refused(PortOf(taken)), !Catch::Contains("the ports after it"));
}

TEST_CASE("Of daemons that are started on one path at once, one alone gets it") {
  const TemporaryFolder folder;
  const std::string path = folder.File("daemon");
  ListenOn(path);  // left by an earlier one
  std::array<Listeners, 4> opened;
  std::atomic<int> got_it = 0;
  std::vector<std::thread> starting;
  starting.reserve(opened.size());
  for (Listeners& mine : opened) {
    starting.emplace_back([&] {
      Result<Listeners> listeners = OpenListeners(OptionsOn(path));
      if (!listeners.ok()) return;
      mine = *std::move(listeners);
      ++got_it;
    });
  }
  for (std::thread& thread : starting) thread.join();
  CHECK(got_it == 1);
  CHECK(std::filesystem::exists(path));
  for (const Listeners& listeners : opened) RemoveSocketFiles(listeners);
  CHECK(std::filesystem::is_empty(folder.path()));
}

TEST_CASE("A socket file that another daemon has put into the place of ours stays") {
  const TemporaryFolder folder;
  const std::string path = folder.File("daemon");
  const Listeners listeners = Take(OpenListeners(OptionsOn(path)));
  REQUIRE(unlink(path.c_str()) == 0);
  const UniqueFd other = ListenOn(path);
  RemoveSocketFiles(listeners);
  CHECK(std::filesystem::exists(path));
  CHECK_FALSE(std::filesystem::exists(path + ".worker-0"));
}

TEST_CASE("With one port, folders that killed daemons have left are removed, and those alone") {
  const TemporaryFolder base;
  const EnvironmentVariable temporary("TMPDIR", base.path());
  const std::string left = base.File("b4mrl-gateway-killed");
  const std::string in_use = base.File("b4mrl-gateway-in-use");
  const std::string users = base.File("b4mrl-gateway-users");
  for (const std::string& folder : {left, in_use, users}) {
    std::filesystem::create_directory(folder);
    ListenOn(folder + "/relay.worker-0");
  }
  const UniqueFd listening = ListenOn(in_use + "/relay.worker-1");
  WriteBytes(users + "/file", "precious");
  ServeOptions options;
  options.binds = {"tcp://127.0.0.1:0"};
  options.workers = 1;
  options.single_port = true;
  const Listeners listeners = Take(OpenListeners(options));
  CHECK_FALSE(std::filesystem::exists(left));
  CHECK(std::filesystem::exists(in_use + "/relay.worker-0"));
  CHECK(std::filesystem::exists(users + "/relay.worker-0"));
  CHECK(std::filesystem::exists(listeners.private_folder + "/relay.worker-0"));
  RemoveSocketFiles(listeners);
  CHECK_FALSE(std::filesystem::exists(listeners.private_folder));
}

TEST_CASE("A daemon's own folder ends with it, and a data folder only where it is the one in it") {
  const TemporaryFolder outside;
  const std::string own = outside.File("b4mrl-own"), users = outside.File("users");
  const std::string parents[] = {own, outside.path(), users};
  const std::string data = parents[GENERATE(0, 1, 2)] + "/data";
  const bool is_inside = data == own + "/data";
  std::filesystem::create_directories(own);
  std::filesystem::create_directories(users);
  std::filesystem::create_directories(data + "/.b4mrl-cache/models");
  std::ofstream(data + "/.b4mrl-cache/models/file") << "compiled";
  ServeOptions options = OptionsOn(own + "/serve");
  options.binds.push_back("ipc://" + users + "/socket");  // which the user has added
  options.own_folder = GENERATE(true, false);
  options.data_folder = data;
  RemoveSocketFiles(Take(OpenListeners(options)));
  CHECK_FALSE(std::filesystem::exists(own + "/serve"));
  CHECK(std::filesystem::exists(own) == !options.own_folder);
  CHECK(std::filesystem::exists(users));
  CHECK(std::filesystem::exists(data + "/.b4mrl-cache/models/file") ==
        !(is_inside && options.own_folder));
}

TEST_CASE("An address of one host and one of all hosts go together") {
  ServeOptions options;
  options.binds = {"tcp://127.0.0.1:0", "tcp://0.0.0.0:0"};
  options.insecure = true;
  options.workers = 2;
  options.no_door = true;
  const Listeners listeners = Take(OpenListeners(options));
  CHECK(listeners.gateway.size() == 2);
  REQUIRE(listeners.worker_ports.size() == 2);
  for (const ChildOptions::Port& port : listeners.worker_ports) CHECK(port.tcp != 0);
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
