// How long a client waits for a server that does not answer: because the caller is to end, or the
// daemon has ended.
#include <atomic>
#include <catch2/catch.hpp>
#include <chrono>
#include <string>
#include <thread>

#include "client/connection.h"
#include "tests/client/fake_server.h"

namespace b4mrl {
namespace {

constexpr int64_t kPatientMs = 600'000;

pb::Request Hello(const std::string& text) {
  pb::Request request;
  request.mutable_hello()->set_client(text);
  return request;
}

TEST_CASE("a server that is not there is unavailable") {
  const SocketFolder folder;
  Context context;
  Result<Connection> connection = Connection::Open(context, folder.Address("nobody"), "");
  REQUIRE(connection.ok());
  const auto reply = connection->Call(Hello("x"), Frame(), Deadline::AfterMs(100));
  CHECK(reply.status().code() == StatusCode::kUnavailable);
}

TEST_CASE("a cancelled wait goes on for as long as it was told, while the server is silent") {
  constexpr std::chrono::seconds kGrace{3};  // ample for an echo
  const SocketFolder folder;
  Context context;
  std::atomic<bool> cancelled = false;
  const FakeServerThread server(folder.Address(), [](FakeServer& own, FakeCall& call) {
    if (call.request.hello().client() == "answered") own.Echo(call);
  });
  Result<Connection> connection = Connection::Open(context, folder.Address(), "", &cancelled);
  REQUIRE(connection.ok());
  connection->DelayCancellation(kGrace);
  cancelled = true;
  const auto call = [&](const std::string& text) {
    return connection->Call(Hello(text), Frame(), Deadline::AfterMs(kPatientMs)).status();
  };
  const Clock::time_point asked = Clock::now();
  CHECK(call("silence").code() == StatusCode::kUnavailable);
  CHECK(Clock::now() >= asked + kGrace);
  // Each further request gets the time anew, though it has run out since the cancellation.
  CHECK(call("answered").ok());
  CHECK(call("answered").ok());
}

TEST_CASE("a wait for the first connection ends when it is cancelled meanwhile") {
  const SocketFolder folder;
  Context context;
  std::atomic<bool> cancelled = false;
  Result<Connection> connection =
      Connection::Open(context, folder.Address("nobody"), "", &cancelled);
  REQUIRE(connection.ok());
  std::thread caller([&] {
    FakeServer unused(folder.Address("unused"));
    (void)unused.Take(100);  // long enough for the wait to have begun
    cancelled = true;
  });
  const Clock::time_point start = Clock::now();
  CHECK_FALSE(connection->AwaitHandshake(Deadline::AfterMs(kPatientMs)));
  CHECK(connection->IsCancelled());
  CHECK(SecondsSince(start) < 60);  // a tenth of the deadline
  caller.join();
}

TEST_CASE("a daemon that has ended is given up after ten seconds, and its address is named") {
  const SocketFolder folder;
  Context context;
  Result<Connection> connection = Connection::Open(context, folder.Address(), "");
  REQUIRE(connection.ok());
  {
    const FakeServerThread server(folder.Address(),
                                  [](FakeServer& own, FakeCall& call) { own.Echo(call); });
    REQUIRE(connection->Call(Hello("x"), Frame(), Deadline::AfterMs(kPatientMs)).ok());
  }
  const Clock::time_point start = Clock::now();
  const auto lost = connection->Send(Hello("lost"), Frame(), Deadline::AfterMs(kPatientMs));
  const auto hurried = connection->Send(Hello("hurried"), Frame(), Deadline::AfterMs(500));
  REQUIRE((lost.ok() && hurried.ok()));
  // kUnavailable if a busy machine had the client look for the daemon before it gave this up.
  const StatusCode late = connection->Receive(*hurried).status().code();
  CHECK((late == StatusCode::kDeadlineExceeded || late == StatusCode::kUnavailable));
  const Status status = connection->Receive(*lost).status();
  CHECK(status.code() == StatusCode::kUnavailable);
  CHECK(status.message() ==
        "nobody listens at " + folder.Address() + " any more; has the daemon ended?");
  CHECK(SecondsSince(start) >= 10);
  CHECK(SecondsSince(start) < 60);  // a tenth of the deadline
}

TEST_CASE("a daemon that is started again in time answers what was asked before") {
  const SocketFolder folder;
  Context context;
  Result<Connection> connection = Connection::Open(context, folder.Address(), "");
  REQUIRE(connection.ok());
  const auto echo = [](FakeServer& own, FakeCall& call) { own.Echo(call); };
  {
    const FakeServerThread server(folder.Address(), echo);
    REQUIRE(connection->Call(Hello("x"), Frame(), Deadline::AfterMs(kPatientMs)).ok());
  }
  const auto lost = connection->Send(Hello("lost"), Frame(), Deadline::AfterMs(kPatientMs));
  const auto hurried = connection->Send(Hello("hurried"), Frame(), Deadline::AfterMs(2'500));
  REQUIRE((lost.ok() && hurried.ok()));
  // Long enough for the client to see that nobody listens.
  CHECK_FALSE(connection->Receive(*hurried).ok());
  const FakeServerThread server(folder.Address(), echo);
  CHECK(connection->Receive(*lost).ok());
}

}  // namespace
}  // namespace b4mrl
