// What a client that breaks every rule of the local door can do: nothing to others. And what a
// client notices for whom there is no door: nothing.
#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <catch2/catch.hpp>
#include <cstring>
#include <thread>

#include "client/link.h"
#include "proto/base/limits.h"
#include "proto/base/rng.h"
#include "proto/wire/door.h"
#include "tests/integration/support/daemon.h"
#include "tests/integration/support/door_clients.h"

namespace b4mrl {
namespace {

// --- A client that breaks every rule ---

UniqueFd ConnectTo(const std::string& door) {
  UniqueFd fd(socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0));
  const timeval patience{10, 0};
  setsockopt(fd.get(), SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof(patience));
  sockaddr_un address;
  const socklen_t size = DoorAddress(door, &address);
  if (connect(fd.get(), reinterpret_cast<const sockaddr*>(&address), size) != 0) fd.Reset();
  return fd;
}

// Receives a greeting and the memory's descriptor; an invalid one if none comes.
UniqueFd ReceiveGreeting(int socket, DoorGreeting* greeting) {
  iovec bytes{greeting, sizeof(*greeting)};
  alignas(cmsghdr) char control[CMSG_SPACE(sizeof(int))] = {};
  msghdr message{};
  message.msg_iov = &bytes;
  message.msg_iovlen = 1;
  message.msg_control = control;
  message.msg_controllen = sizeof(control);
  if (recvmsg(socket, &message, 0) != sizeof(*greeting)) return UniqueFd();
  const cmsghdr* const header = CMSG_FIRSTHDR(&message);
  if (header == nullptr) return UniqueFd();
  int fd = -1;
  std::memcpy(&fd, CMSG_DATA(header), sizeof(fd));
  return UniqueFd(fd);
}

// One datagram with a descriptor.
void SendWithDescriptor(int socket, const void* data, size_t size, int fd) {
  iovec bytes{const_cast<void*>(data), size};
  alignas(cmsghdr) char control[CMSG_SPACE(sizeof(int))] = {};
  msghdr message{};
  message.msg_iov = &bytes;
  message.msg_iovlen = 1;
  message.msg_control = control;
  message.msg_controllen = sizeof(control);
  cmsghdr* const header = CMSG_FIRSTHDR(&message);
  header->cmsg_level = SOL_SOCKET;
  header->cmsg_type = SCM_RIGHTS;
  header->cmsg_len = CMSG_LEN(sizeof(int));
  std::memcpy(CMSG_DATA(header), &fd, sizeof(int));
  sendmsg(socket, &message, MSG_DONTWAIT | MSG_NOSIGNAL);
}

// A position near another one, as a writer's or a reader's may be, or anywhere.
uint64_t Near(uint64_t position, Rng& rng) {
  switch (rng.Below(4)) {
    case 0:
      return rng.NextUint64();
    case 1:
      return position + rng.Below(1000);
    default:
      return position + kRingLine * rng.Below(100);
  }
}

// One breach of the rules, of many.
void Break(const Ring& ring, std::atomic<uint32_t>* sleeps, Rng& rng) {
  switch (rng.Below(6)) {
    case 0:
      *ring.head = Near(*ring.head, rng);
      break;
    case 1:
      *ring.tail = Near(*ring.tail, rng);
      break;
    case 2:
      *sleeps = static_cast<uint32_t>(rng.Below(5));
      break;
    case 3: {  // a message of random bytes, with a prefix as it should be, or not quite
      const uint32_t lengths[4] = {static_cast<uint32_t>(rng.Below(70'000)),
                                   static_cast<uint32_t>(rng.NextUint64() >> rng.Below(64)),
                                   rng.Below(10) == 0 ? 1u : 0u, 0};
      std::memcpy(ring.bytes + *ring.head % ring.size / kRingLine * kRingLine, lengths,
                  sizeof(lengths));
      *ring.head += kRingLine * (1 + rng.Below(200));
      break;
    }
    default:
      for (int i = 0; i < 100; ++i) {
        ring.bytes[rng.Below(ring.size)] = static_cast<std::byte>(rng.Below(256));
      }
  }
}

// A connection on which every rule is broken. Whether it came about, and the memory's size stayed.
bool Scribble(const std::string& door, uint64_t seed) {
  Rng rng(seed, "scribbles");
  const UniqueFd socket = ConnectTo(door);
  DoorGreeting greeting;
  UniqueFd fd = socket.valid() ? ReceiveGreeting(socket.get(), &greeting) : UniqueFd();
  if (!fd.valid()) return false;
  const bool is_sealed = ftruncate(fd.get(), static_cast<off_t>(rng.Below(8192))) != 0;
  const UniqueFd passed(dup(fd.get()));
  const Result<DoorMemory> memory = DoorMemory::Map(std::move(fd), greeting);
  if (!memory.ok()) return false;
  for (uint64_t i = rng.Below(30); i > 0; --i) {
    Break(rng.Below(3) == 0 ? memory->down() : memory->up(),
          rng.Below(2) == 0 ? &memory->words().worker_sleeps : &memory->words().client_sleeps, rng);
    const char bells[100] = {};
    for (uint64_t bell = rng.Below(4) == 0 ? rng.Below(300) : 1; bell > 0; --bell) {
      send(socket.get(), bells, 1 + rng.Below(sizeof(bells)), MSG_DONTWAIT | MSG_NOSIGNAL);
    }
    if (rng.Below(10) == 0) SendWithDescriptor(socket.get(), bells, 1, passed.get());
  }
  return is_sealed;
}

// Returns what was done.
std::string WalkBesideScribbler(uint64_t connections) {
  PrivateDaemon daemon = StartDoorDaemon();
  Client client = Connect(daemon.endpoint());
  LaneWalk walk = OpenDoorWalk(client);
  const std::string door = walk.environment().in_force().port().door();
  const ProcessView before = LookAt(client, "worker-0");
  const Holdings held = HoldingsOf(before.process_id);
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
  return fmt::format("{:.0f} steps a second beside a client that scribbled on {} connections",
                     static_cast<double>(walk.FinishedSteps()) / seconds, connections);
}

TEST_CASE("A client that breaks every rule of the door harms neither worker nor other clients") {
  WalkBesideScribbler(500);
}

TEST_CASE("10,000 connections of a client that breaks every rule harm nobody", "[.][long]") {
  WARN(WalkBesideScribbler(10'000));
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
      others.push_back(ConnectTo(door));
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

// Listens under a name that is no worker's.
UniqueFd ListenAs(const std::string& name) {
  UniqueFd fd(socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0));
  sockaddr_un address;
  const socklen_t size = DoorAddress(name, &address);
  REQUIRE(bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), size) == 0);
  REQUIRE(listen(fd.get(), 16) == 0);
  return fd;
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
    const UniqueFd listener = ListenAs(name);
    CHECK(transport(100) == "ipc");
  }
  SECTION("that greets wrongly") {
    const UniqueFd listener = ListenAs(name);
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
        SendWithDescriptor(socket.get(), &greeting, sizeof(greeting), memory.fd());
      }
    });
    CHECK(transport(60'000) == "ipc");
    done = true;
    worker.join();
  }
}

}  // namespace
}  // namespace b4mrl
