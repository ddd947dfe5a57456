// What a worker grants its doors' clients.
#include <sys/socket.h>

#include <catch2/catch.hpp>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "proto/base/limits.h"
#include "server/door/doors.h"
#include "tests/server/door/raw_client.h"

namespace b4mrl {
namespace {

// A client that has sent a message, and reads no reply unless it is told to.
struct Asking {
  const std::string name = NewName();
  const UniqueFd listener = Listen(name);
  Doors doors;
  RawClient client{name, doors};
  RoutingId id;

  explicit Asking(UnreadBytes unread = UnreadBytes())
      : doors(listener.get(), 0, std::move(unread)) {
    client.Publish(MessageOf(0, 'q'));
    const std::optional<IncomingMessage> request = doors.TryReceive();
    REQUIRE(request);
    id = request->sender;
  }
};

TEST_CASE("A client that does not read is sent no more replies than the limit of bytes") {
  Asking it;
  Frame payload = Frame::OfSize(limits::kMaxPayloadBytes);  // few of its pages are touched
  const auto send = [&] { return it.doors.Send(it.id, {Frame(), payload.Share()}).code(); };
  for (size_t i = 0; i < limits::kMaxUnreadBytes / limits::kMaxPayloadBytes; ++i) {
    REQUIRE(send() == StatusCode::kOk);
  }
  CHECK(send() == StatusCode::kLimitExceeded);
}

TEST_CASE("A client that does not read is sent no more replies than the limit of messages") {
  Asking it;
  const auto send = [&] { return it.doors.Send(it.id, MessageOf(1, 'r')).code(); };
  // Those that find room in the ring do not wait; each takes a line of it or more.
  constexpr int kMost = limits::kHighWaterMark + limits::kRingBytes / kRingLine;
  int sent = 0;
  while (sent <= kMost && send() == StatusCode::kOk) ++sent;
  CHECK(sent > limits::kHighWaterMark);
  CHECK(sent <= kMost);
  CHECK(send() == StatusCode::kLimitExceeded);
  REQUIRE(it.client.Take() == RingResult::kMoved);
  it.doors.TryReceive();  // publishes what there is room for by now
  CHECK(send() == StatusCode::kOk);
}

TEST_CASE("Replies over the socket count among those that a worker's clients have not read") {
  constexpr size_t kBytes = 300'000;  // more than a ring, so that a part waits
  UnreadBytes of_the_socket({.of_one = 4 * kBytes, .of_all = 4 * kBytes});
  Asking it(of_the_socket.Beside());
  const auto send = [&] { return it.doors.Send(it.id, MessageOf(kBytes, 'r')).code(); };
  Message elsewhere = MessageOf(2 * kBytes, 'e');
  REQUIRE(of_the_socket.Count("peer", &elsewhere).ok());
  CHECK(send() == StatusCode::kOk);
  CHECK(send() == StatusCode::kLimitExceeded);
  elsewhere = Message();
  CHECK(send() == StatusCode::kOk);
}

TEST_CASE("A client that rings without end is dropped") {
  const std::string name = NewName();
  const UniqueFd listener = Listen(name);
  Doors doors(listener.get(), 0);
  const UniqueFd client = ConnectToDoor(name);
  doors.Attend();
  REQUIRE(doors.any());
  const char bell = 0;
  for (uint32_t i = 0; i <= limits::kMaxDoorBells; ++i) {
    while (send(client.get(), &bell, 1, MSG_DONTWAIT | MSG_NOSIGNAL) < 0 && doors.any()) {
      doors.Attend();
    }
  }
  for (int i = 0; i < 1000 && doors.any(); ++i) doors.Attend();
  CHECK_FALSE(doors.any());
}

TEST_CASE("Bells of a client that reads long replies are not counted as rung without end") {
  Asking it;
  // As many bells as a client may ring in vain, each after bytes that it has taken.
  for (uint32_t i = 0; i <= limits::kMaxDoorBells; ++i) {
    REQUIRE(it.doors.Send(it.id, MessageOf(10, 'r')).ok());
    REQUIRE(it.client.Take() == RingResult::kMoved);
    it.client.Ring();
    it.doors.Attend();
  }
  CHECK(it.doors.any());
}

TEST_CASE("Long messages that are begun and never ended keep no other client's message away") {
  const std::string name = NewName();
  const UniqueFd listener = Listen(name);
  constexpr size_t kFitting = 3;
  Doors doors(listener.get(), 0, UnreadBytes(), kFitting * limits::kMaxPayloadBytes);
  std::vector<std::unique_ptr<RawClient>> stuck;
  for (size_t i = 0; i <= kFitting; ++i) {
    stuck.push_back(std::make_unique<RawClient>(name, doors));
    stuck.back()->Announce(limits::kMaxPayloadBytes - 1024);
    CHECK_FALSE(doors.TryReceive().has_value());
  }
  RawClient other(name, doors);
  other.Publish(MessageOf(100'000, 'y'));
  const std::optional<IncomingMessage> message = doors.TryReceive();
  REQUIRE(message);
  CHECK(message->message.payload.view() == std::string(100'000, 'y'));
  doors.Attend();
  CHECK_FALSE(other.IsDropped());
  // Those that have stood still for longest made room.
  CHECK(stuck.front()->IsDropped());
  CHECK_FALSE(stuck.back()->IsDropped());
}

TEST_CASE("A message above the limit of what has not come entirely is taken if it is alone") {
  const std::string name = NewName();
  const UniqueFd listener = Listen(name);
  Doors doors(listener.get(), 0, UnreadBytes(), /*unfinished_bytes=*/1000);
  RawClient client(name, doors);
  client.Announce(limits::kMaxPayloadBytes - 1024);
  CHECK_FALSE(doors.TryReceive().has_value());
  doors.Attend();
  CHECK_FALSE(client.IsDropped());
}

}  // namespace
}  // namespace b4mrl
