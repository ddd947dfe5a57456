// What a client that breaks every rule of the local door can do: nothing to others. And what a
// client notices for whom there is no door: nothing.
#include <fmt/format.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <catch2/catch.hpp>
#include <thread>

#include "client/link.h"
#include "proto/base/limits.h"
#include "proto/wire/client_door.h"
#include "proto/wire/door.h"
#include "tests/integration/door/scribbler.h"
#include "tests/integration/support/daemon.h"
#include "tests/integration/support/door_clients.h"
#include "tests/integration/support/raw_zmtp.h"
#include "tests/proto/wire/raw_door.h"

namespace b4mrl {
namespace {

constexpr int64_t kPatienceMs = 5'000;

// Returns what was done.
std::string WalkBesideScribbler(uint64_t connections) {
  PrivateDaemon daemon = StartDoorDaemon();
  Client client = Connect(daemon.endpoint());
  LaneWalk walk = OpenDoorWalk(client);
  const std::string door = walk.environment().in_force().port().door();
  const ProcessView before = LookAt(client, "worker-0");
  const Holdings held = HoldingsOf(before.process_id);
  const Clock::time_point begin = Clock::now();
  RequireOk(walk.RunTo(connections / 2));
  const double alone = static_cast<double>(walk.FinishedSteps()) / SecondsSince(begin);
  uint64_t scribbled = 0;
  double seconds = 0;
  WalkBeside(walk, [&] {
    const Clock::time_point start = Clock::now();
    for (uint64_t seed = 0; seed < connections; ++seed) scribbled += Scribble(door, seed) ? 1 : 0;
    seconds = SecondsSince(start);
  });
  CHECK(scribbled == connections);
  CHECK(walk.environment().transport() == "door");
  RequireUnharmed(client, before, held);
  RequireUndisturbedBytes(walk);
  const auto steps = static_cast<double>(walk.FinishedSteps() - connections / 2);
  return fmt::format(
      "{:.0f} steps a second alone, {:.0f} beside a client that scribbled on {} "
      "connections",
      alone, steps / seconds, connections);
}

TEST_CASE("A client that breaks every rule of the door harms neither worker nor other clients") {
  WalkBesideScribbler(500);
}

TEST_CASE("Ten thousand connections of a client that breaks every rule harm nobody", "[.][long]") {
  WARN(WalkBesideScribbler(10'000));
}

TEST_CASE(
    "A peer of the worker's socket that names itself as a client of a door gets its own replies") {
  PrivateDaemon daemon = StartDoorDaemon({}, true);
  Client client = Connect(daemon.endpoint());
  const RemoteEnvironment environment = Take(client.Make("HalfCheetah"));
  const pb::Port port = environment.in_force().port();
  ClientDoor door = Take(ClientDoor::Connect(port.door(), Deadline::AfterMs(kPatienceMs)));
  // The numbers of this worker's doors begin with 1; routing ids are what a peer says they are.
  for (uint64_t number = 1; number <= 3; ++number) {
    std::string name(reinterpret_cast<const char*>(&number), sizeof(number));
    for (const std::string& identity : {name, '\0' + name}) {
      CAPTURE(number, identity.size());
      RawZmtp peer(fmt::format("tcp://127.0.0.1:{}", port.tcp()));
      REQUIRE(peer.ShakeHands(identity));
      REQUIRE(peer.SendMessage({"no request"}));
      CHECK(peer.Receive(kPatienceMs).size() == 1);
      CHECK_FALSE(door.Receive(Deadline::AfterMs(0)).has_value());
    }
  }
}

// --- No door ---

TEST_CASE("A client for whom a worker has no door left goes over ZeroMQ without a report") {
  PrivateDaemon daemon = StartDoorDaemon();
  Client client = Connect(daemon.endpoint());
  std::vector<std::string> reports;
  client.set_reporter([&reports](const std::string& text) { reports.push_back(text); });
  std::string door;
  {
    LaneWalk first = OpenDoorWalk(client);
    REQUIRE(first.environment().transport() == "door");
    door = first.environment().in_force().port().door();
    std::vector<UniqueFd> others;
    for (uint32_t i = 1; i < limits::kMaxDoors; ++i) {
      others.push_back(ConnectToDoor(door));
      DoorGreeting greeting;
      REQUIRE(ReceiveGreeting(others.back().get(), &greeting).valid());
    }
    LaneWalk second = OpenDoorWalk(client);
    CHECK(second.environment().transport() == "ipc");
    RequireOk(second.RunTo(60));
    RequireOk(first.RunTo(60));
    CHECK(first.environment().transport() == "door");
    RequireUndisturbedBytes(second);
  }
  CHECK(OpenDoorWalk(client).environment().transport() == "door");
  CHECK(reports.empty());
}

TEST_CASE("A client of another user goes over ZeroMQ without a report") {
  const std::vector<std::string> as_nobody = {"setpriv", "--reuid=65534", "--regid=65534",
                                              "--clear-groups", "--no-new-privs"};
  if (geteuid() != 0) {
    WARN("skipped: only root can become another user");
    return;
  }
  PrivateDaemon daemon = StartDoorDaemon({}, true);
  Walker walker(daemon.endpoint(), as_nobody);
  if (!walker.AwaitLines(20)) {
    WARN("skipped: another user cannot run door_walker");
    return;
  }
  walker.End();
  const std::vector<std::string> lines = walker.lines();
  CHECK(lines.front() == "tcp");
  CHECK(std::ranges::none_of(lines,
                             [](const std::string& line) { return line.starts_with("report"); }));
  UndisturbedWalker undisturbed;
  CHECK(undisturbed.Says(walker.lines().back()));
}

TEST_CASE("A client that finds no door, or a strange one, goes over ZeroMQ") {
  const std::string name = fmt::format("b4mrl-door-test-{}", getpid());
  const auto transport = [&](int64_t patience_ms) {
    Context context;
    Link link = Take(
        Link::Open(context, "ipc:///nowhere/b4mrl.sock", name, Deadline::AfterMs(patience_ms)));
    return std::string(link.transport());
  };
  SECTION("that nobody holds open") { CHECK(transport(60'000) == "ipc"); }
  SECTION("that never greets") {
    const UniqueFd listener = ListenAtDoor(name);
    CHECK(transport(100) == "ipc");
  }
  SECTION("that never greets, and is not waited for by a client that is cancelled") {
    const UniqueFd listener = ListenAtDoor(name);
    const std::atomic<bool> cancelled{true};
    Context context;
    const Deadline deadline = Deadline::AfterMs(60'000);
    const Link link =
        Take(Link::Open(context, "ipc:///nowhere/b4mrl.sock", name, deadline, &cancelled));
    CHECK(link.transport() == "ipc");
    CHECK_FALSE(deadline.expired());
  }
  SECTION("that greets wrongly") {
    const UniqueFd listener = ListenAtDoor(name);
    const uint32_t version = GENERATE(0u, 2u);  // 0: closes the connection
    CAPTURE(version);
    DoorMemory memory = Take(DoorMemory::Create(limits::kRingBytes, limits::kRingBytes));
    DoorGreeting greeting;
    greeting.version = version;
    greeting.up_bytes = greeting.down_bytes = limits::kRingBytes;
    std::atomic<bool> done{false};
    std::thread worker([&] {
      while (!done) {
        pollfd waited{listener.get(), POLLIN, 0};
        if (poll(&waited, 1, 10) <= 0) continue;
        const UniqueFd socket(accept(listener.get(), nullptr, nullptr));
        if (version == 0) continue;
        SendWithDescriptors(socket.get(), &greeting, sizeof(greeting), std::array{memory.fd()});
      }
    });
    CHECK(transport(60'000) == "ipc");
    done = true;
    worker.join();
  }
}

}  // namespace
}  // namespace b4mrl
