#include "server/door/doors.h"

#include <poll.h>
#include <sys/socket.h>

#include <array>
#include <atomic>
#include <catch2/catch.hpp>
#include <filesystem>
#include <thread>

#include "proto/base/limits.h"
#include "proto/wire/client_door.h"
#include "proto/wire/door.h"
#include "tests/proto/wire/raw_door.h"
#include "tests/server/door/raw_client.h"

namespace b4mrl {
namespace {

// A worker's loop in a thread of its own, which sends every message back.
class EchoWorker {
 public:
  explicit EchoWorker(int listener, uint32_t spin_us = 0)
      : doors_(listener, spin_us), thread_([this] { Run(); }) {}
  ~EchoWorker() { Stop(); }
  void Stop() {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
  }
  size_t echoed() const { return echoed_; }

 private:
  void Run() {
    while (!stop_) {
      doors_.Attend();
      while (std::optional<IncomingMessage> incoming = doors_.TryReceive()) {
        if (doors_.Send(incoming->sender, std::move(incoming->message)).ok()) ++echoed_;
      }
      pollfd waited{doors_.epoll_fd(), POLLIN, 0};
      if (doors_.BeginSleep()) poll(&waited, 1, 10);
      doors_.EndSleep();
    }
    doors_.Drain(1000);
  }

  Doors doors_;
  std::atomic<bool> stop_{false};
  std::atomic<size_t> echoed_{0};
  std::thread thread_;
};

ClientDoor Connect(const std::string& name) {
  Result<ClientDoor> door = ClientDoor::Connect(name, Deadline::AfterMs(10'000));
  INFO(door.status().ToString());
  REQUIRE(door.ok());
  return std::move(*door);
}

std::optional<Message> ReceiveFrom(ClientDoor& door) {
  const Deadline deadline = Deadline::AfterMs(30'000);
  std::optional<Message> message;
  while (!message && !deadline.expired()) message = door.Receive(deadline);
  return message;
}

size_t OpenDescriptors() {
  const std::filesystem::directory_iterator all("/proc/self/fd");
  return static_cast<size_t>(std::distance(begin(all), end(all)));
}

TEST_CASE("A door carries messages of any size there and back") {
  const std::string name = NewName();
  const UniqueFd listener = Listen(name);
  EchoWorker worker(listener.get(), GENERATE(0u, 100u));
  ClientDoor door = Connect(name);
  for (const size_t size : {0ul, 1ul, 100ul, 70'000ul, 300'000ul, 5'000'000ul}) {
    REQUIRE(door.Send(MessageOf(size, 'x')).ok());
    const std::optional<Message> reply = ReceiveFrom(door);
    REQUIRE(reply.has_value());
    CHECK(reply->envelope.view() == "envelope");
    CHECK(reply->payload.view() == std::string(size, 'x'));
  }
}

TEST_CASE("Several clients of a door get their own replies") {
  const std::string name = NewName();
  const UniqueFd listener = Listen(name);
  EchoWorker worker(listener.get());
  ClientDoor first = Connect(name), second = Connect(name);
  for (int i = 0; i < 100; ++i) {
    REQUIRE(first.Send(MessageOf(64, 'a')).ok());
    REQUIRE(second.Send(MessageOf(200'000, 'b')).ok());
    const std::optional<Message> to_second = ReceiveFrom(second), to_first = ReceiveFrom(first);
    REQUIRE((to_first && to_second));
    CHECK(to_first->payload.view() == std::string(64, 'a'));
    CHECK(to_second->payload.view() == std::string(200'000, 'b'));
  }
}

TEST_CASE("A client finds the replacement of its worker and counts the connection") {
  const std::string name = NewName();
  const UniqueFd listener = Listen(name);
  auto worker = std::make_unique<EchoWorker>(listener.get());
  ClientDoor door = Connect(name);
  CHECK(door.connections() == 1);
  worker.reset();
  worker = std::make_unique<EchoWorker>(listener.get());
  const Deadline deadline = Deadline::AfterMs(30'000);
  while (door.connections() == 1 && !deadline.expired()) door.Receive(deadline);
  REQUIRE(door.connections() == 2);
  REQUIRE(door.Send(MessageOf(10, 'z')).ok());
  CHECK(ReceiveFrom(door).has_value());
}

TEST_CASE("A door that nobody holds open any more is refused") {
  const std::string name = NewName();
  ClientDoor door = [&] {
    const UniqueFd listener = Listen(name);
    EchoWorker worker(listener.get());
    return Connect(name);
  }();
  const Deadline deadline = Deadline::AfterMs(30'000);
  while (!door.is_refused() && !deadline.expired()) door.Receive(deadline);
  CHECK(door.is_refused());
  CHECK(ClientDoor::Connect(name, deadline).status().code() == StatusCode::kUnavailable);
}

TEST_CASE("A client that cannot be served is closed at once, and the others go on") {
  const std::string name = NewName();
  const UniqueFd listener = Listen(name);
  Doors doors(listener.get(), 0);
  std::vector<UniqueFd> clients;
  for (uint32_t i = 0; i <= limits::kMaxDoors; ++i) {
    clients.push_back(ConnectToDoor(name));
    doors.Attend();
  }
  DoorGreeting greeting;
  CHECK(recv(clients[limits::kMaxDoors - 1].get(), &greeting, sizeof(greeting), 0) ==
        sizeof(greeting));
  CHECK(recv(clients[limits::kMaxDoors].get(), &greeting, sizeof(greeting), 0) == 0);
}

TEST_CASE("What a client sent before its end is taken, and nobody is answered") {
  const std::string name = NewName();
  const UniqueFd listener = Listen(name);
  Doors doors(listener.get(), 0);
  const size_t before = OpenDescriptors();
  std::make_unique<RawClient>(name, doors)->Publish(MessageOf(1, 'a'));
  {
    RawClient client(name, doors);
    client.Publish(MessageOf(1000, 'b'));
    client.Publish(MessageOf(70'000, 'c'));
    client.Publish(MessageOf(300'000, 'd'));  // longer than what is left of the ring
  }
  doors.Attend();
  CHECK(OpenDescriptors() == before);
  for (const auto& [size, letter] : {std::pair{1, 'a'}, {1000, 'b'}, {70'000, 'c'}}) {
    const std::optional<IncomingMessage> message = doors.TryReceive();
    REQUIRE(message);
    CHECK(message->message.payload.view() == std::string(static_cast<size_t>(size), letter));
    CHECK(doors.Send(message->sender, MessageOf(1, 'r')).code() == StatusCode::kUnavailable);
  }
  CHECK_FALSE(doors.TryReceive().has_value());
  doors.Attend();
  CHECK_FALSE(doors.any());
}

TEST_CASE("A client that goes on writing after its end is let go") {
  const std::string name = NewName();
  const UniqueFd listener = Listen(name);
  Doors doors(listener.get(), 0);
  RawClient client(name, doors);
  client.Publish(MessageOf(1, 'x'));
  client.End();
  doors.Attend();
  for (size_t i = 0; i < limits::kRingBytes / kRingLine; ++i) {
    REQUIRE(doors.TryReceive());
    client.Publish(MessageOf(1, 'x'));
  }
  CHECK_FALSE(doors.TryReceive().has_value());
  doors.Attend();
  CHECK_FALSE(doors.any());
}

TEST_CASE("A client that goes leaves no descriptor and no door behind") {
  const std::string name = NewName();
  const UniqueFd listener = Listen(name);
  Doors doors(listener.get(), 0);
  const size_t before = OpenDescriptors();
  for (int i = 0; i < 50; ++i) {
    const UniqueFd client = ConnectToDoor(name);
    doors.Attend();
    CHECK(doors.any());
  }
  doors.Attend();
  CHECK_FALSE(doors.any());
  CHECK(OpenDescriptors() == before);
}

TEST_CASE("A client keeps no descriptor of a greeting that has too many, and does not accept it") {
  const std::string name = NewName();
  UniqueFd listener = Listen(name);
  const Result<DoorMemory> memory = DoorMemory::Create(limits::kRingBytes, limits::kRingBytes);
  REQUIRE(memory.ok());
  DoorGreeting greeting;
  greeting.up_bytes = greeting.down_bytes = limits::kRingBytes;
  const size_t before = OpenDescriptors();
  std::thread worker([&] {
    pollfd waited{listener.get(), POLLIN, 0};
    poll(&waited, 1, 10'000);
    const UniqueFd socket(accept(listener.get(), nullptr, nullptr));
    SendWithDescriptors(socket.get(), &greeting, sizeof(greeting),
                        std::array{memory->fd(), memory->fd()});
    listener.Reset();  // the client's next attempt is refused
  });
  CHECK_FALSE(ClientDoor::Connect(name, Deadline::AfterMs(10'000)).ok());
  worker.join();
  CHECK(OpenDescriptors() == before - 1);  // without the listener's
}

}  // namespace
}  // namespace b4mrl
