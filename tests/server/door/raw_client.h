// A client's end of a door by hand, so that a test can send what no client would. Thread rule: the
// thread of the doors that it is a client of.
#pragma once

#include <fmt/format.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <catch2/catch.hpp>
#include <cstring>
#include <optional>
#include <string>

#include "proto/wire/door.h"
#include "server/door/doors.h"
#include "tests/proto/wire/raw_door.h"

namespace b4mrl {

inline std::string NewName() {
  static std::atomic<int> number{0};
  return fmt::format("b4mrl-doors-test-{}-{}", getpid(), number++);
}

inline UniqueFd Listen(const std::string& name) {
  UniqueFd fd = ListenAtDoor(name);
  REQUIRE(fd.valid());
  return fd;
}

class RawClient {
 public:
  RawClient(const std::string& name, Doors& doors) : socket_(ConnectToDoor(name)) {
    doors.Attend();
    DoorGreeting greeting;
    UniqueFd fd = ReceiveGreeting(socket_.get(), &greeting);
    REQUIRE(fd.valid());
    memory_ = std::move(*DoorMemory::Map(std::move(fd), greeting));
    writer_.emplace(memory_.up());
  }

  void Publish(Message message) {
    writer_->Push(std::move(message));
    REQUIRE(writer_->Write() == RingResult::kMoved);
  }
  // Publishes the beginning of a message with a payload of so many bytes.
  void Announce(size_t payload) {
    const uint32_t prefix[4] = {0, static_cast<uint32_t>(payload), 0, 0};
    std::memcpy(memory_.up().bytes, prefix, sizeof(prefix));
    *memory_.up().head += kRingLine;
  }
  void Ring() { REQUIRE(send(socket_.get(), "", 1, MSG_NOSIGNAL) == 1); }
  // Takes what the worker has sent.
  RingResult Take() {
    if (!reader_) reader_.emplace(memory_.down());
    Message message;
    bool is_whole = false;
    return reader_->Take(&message, &is_whole);
  }
  void End() { socket_.Reset(); }
  // Whether the worker has ended the connection.
  bool IsDropped() const {
    char bell = 0;
    return recv(socket_.get(), &bell, 1, MSG_DONTWAIT) == 0;
  }

 private:
  UniqueFd socket_;
  DoorMemory memory_;
  std::optional<RingWriter> writer_;
  std::optional<RingReader> reader_;
};

inline Message MessageOf(size_t payload, char letter) {
  return {Frame::Copy("envelope"), Frame::Copy(std::string(payload, letter))};
}

}  // namespace b4mrl
