#include "proto/wire/socket.h"

#include <unistd.h>
#include <zmq.h>

#include <catch2/catch.hpp>
#include <cstring>
#include <initializer_list>
#include <string>
#include <string_view>

#include "proto/base/limits.h"

namespace b4mrl {
namespace {

constexpr int64_t kPatienceMs = 10'000;

std::string FreshAddress() {
  static int number = 0;
  return "ipc://@b4mrl-socket-" + std::to_string(getpid()) + "-" + std::to_string(number++);
}

RouterSocket Listen(Context& context, const std::string& address) {
  const ListeningEndpoint endpoint{address};
  Result<RouterSocket> router = RouterSocket::Bind(context, std::span(&endpoint, 1));
  INFO(router.status().ToString());
  REQUIRE(router.ok());
  return std::move(*router);
}

IncomingMessage Take(RouterSocket& router) {
  void* const socket = router.handle();
  REQUIRE(WaitAnyReadable({&socket, 1}, kPatienceMs));
  std::optional<IncomingMessage> message = router.TryReceive();
  REQUIRE(message.has_value());
  return std::move(*message);
}

// A server and a client that has said "hello".
struct Connection {
  Context context;  // outlives the sockets
  const std::string address = FreshAddress();
  RouterSocket router = Listen(context, address);
  DealerSocket dealer = std::move(*DealerSocket::Connect(context, address));
  RoutingId client;
  Connection() {
    REQUIRE(dealer.Send({Frame::Copy("hello"), Frame()}).ok());
    client = Take(router).sender;
  }
};

Message Text(std::string_view envelope, std::string_view payload = {}) {
  return {Frame::Copy(envelope), payload.empty() ? Frame() : Frame::Copy(payload)};
}

TEST_CASE("messages go there and back, with and without a payload") {
  Context context;
  const std::string address = FreshAddress();
  RouterSocket router = Listen(context, address);
  DealerSocket dealer = std::move(*DealerSocket::Connect(context, address));
  REQUIRE(dealer.Send(Text("question", "with payload")).ok());
  const IncomingMessage question = Take(router);
  CHECK(question.message.envelope.view() == "question");
  CHECK(question.message.payload.view() == "with payload");

  REQUIRE(router.Send(question.sender, Text("answer")).ok());
  std::optional<Message> answer;
  for (const Deadline deadline = Deadline::AfterMs(kPatienceMs);
       !(answer = dealer.TryReceive()) && !deadline.expired();) {
    dealer.Wait(deadline);
    (void)dealer.connections();  // takes the event that would wake Wait again
  }
  REQUIRE(answer.has_value());
  CHECK(answer->envelope.view() == "answer");
  CHECK(answer->payload.size() == 0);
  CHECK(dealer.connections() == 1);
}

TEST_CASE("a client takes a message with surplus frames for an empty one") {
  Connection connection;
  const auto send = [&](std::initializer_list<std::string_view> frames) {
    void* const socket = connection.router.handle();
    zmq_send(socket, connection.client.data(), connection.client.size(), ZMQ_SNDMORE);
    for (const std::string_view& frame : frames) {
      const bool more = &frame + 1 != frames.end();
      REQUIRE(zmq_send(socket, frame.data(), frame.size(), more ? ZMQ_SNDMORE : 0) >= 0);
    }
  };
  const auto received = [&] {
    std::optional<Message> message = connection.dealer.Receive(Deadline::AfterMs(kPatienceMs));
    REQUIRE(message.has_value());
    return std::string(message->envelope.view()) + "|" + std::string(message->payload.view());
  };
  send({"envelope", "payload"});
  CHECK(received() == "envelope|payload");
  send({"envelope", "payload", ""});
  CHECK(received() == "|");
  send({"envelope", "payload", "more", "and more"});
  CHECK(received() == "|");
}

TEST_CASE("a peer on this machine is told from others, over ipc and over loopback") {
  Context context;
  RouterSocket router = Listen(context, "tcp://127.0.0.1:*");
  char address[64] = "";
  SECTION("tcp") {
    size_t size = sizeof(address);
    REQUIRE(zmq_getsockopt(router.handle(), ZMQ_LAST_ENDPOINT, address, &size) == 0);
  }
  SECTION("ipc") {
    std::strcpy(address, FreshAddress().c_str());
    router = Listen(context, address);
  }
  DealerSocket dealer = std::move(*DealerSocket::Connect(context, address));
  REQUIRE(dealer.Send(Text("question")).ok());
  IncomingMessage question = Take(router);
  CHECK(CameFromThisMachine(question.message));
  Message nobodys = Text("made here");
  CHECK_FALSE(CameFromThisMachine(nobodys));
}

TEST_CASE("a reply to a peer that has gone is an error of the call") {
  Context context;
  RouterSocket router = Listen(context, FreshAddress());
  CHECK(router.Send("nobody", Text("answer")).code() == StatusCode::kUnavailable);
}

TEST_CASE("a server that nobody reads from is not waited for") {
  Connection connection;
  Frame payload = Frame::OfSize(100'000);
  Status status;
  // Both high-water marks and what the kernel buffers.
  for (int i = 0; i < 4 * limits::kHighWaterMark && status.ok(); ++i) {
    status = connection.router.Send(connection.client, {Frame::Copy("x"), payload.Share()});
  }
  CHECK(status.code() == StatusCode::kLimitExceeded);
}

TEST_CASE("long replies that nobody reads are bounded by their bytes") {
  Connection connection;
  Frame payload = Frame::OfSize(limits::kMaxPayloadBytes);
  Status status;
  // To send a share of them takes far less time than the dealer's thread needs to read one.
  for (int i = 0; i < limits::kHighWaterMark / 2 && status.ok(); ++i) {
    status = connection.router.Send(connection.client, {Frame::Copy("x"), payload.Share()});
  }
  CHECK(status.code() == StatusCode::kLimitExceeded);
  CHECK(connection.router.Send(connection.client, Text("short ones are sent")).ok());
}

TEST_CASE("a client's queue towards a server that is not there is bounded") {
  Context context;
  DealerSocket dealer = std::move(*DealerSocket::Connect(context, FreshAddress()));
  Status status;
  int sent = 0;
  for (; sent <= limits::kHighWaterMark && status.ok(); ++sent) status = dealer.Send(Text("x"));
  CHECK(status.code() == StatusCode::kUnavailable);
  CHECK(sent == limits::kHighWaterMark + 1);
  CHECK(dealer.connections() == 0);
}

TEST_CASE("waiting ends at its deadline") {
  Context context;
  DealerSocket dealer = std::move(*DealerSocket::Connect(context, FreshAddress()));
  const Clock::time_point start = Clock::now();
  CHECK_FALSE(dealer.Wait(Deadline::AfterMs(30)));
  CHECK(SecondsSince(start) >= 0.03);
}

}  // namespace
}  // namespace b4mrl
