// What the headers of client and session promise: lifetimes, ends, and bounds of what callers give.
#include <array>
#include <catch2/catch.hpp>
#include <limits>
#include <vector>

#include "client/client.h"
#include "tests/client/fake_daemon.h"

namespace b4mrl {
namespace {

const std::vector<float> kOneAction(kActionSize, 0.5f);

Client ConnectTo(const FakeDaemon& daemon) {
  Result<Client> client = Client::Connect(daemon.address());
  INFO(client.status().ToString());
  REQUIRE(client.ok());
  return std::move(*client);
}

// What is wrong here hangs: the sockets that are left keep ZeroMQ from ending.
TEST_CASE("a client can be assigned another connection") {
  FakeDaemon first, second;
  Client client = ConnectTo(first);
  client = ConnectTo(second);
  CHECK(client.endpoint() == second.address());
  CHECK(client.Make("Fake").ok());
  CHECK(second.closed_sessions() == 1);
  CHECK(first.closed_sessions() == 0);
}

TEST_CASE("a client that cannot connect says where, once") {
  const auto message_of = [](const std::string& address) {
    const Result<Client> client = Client::Connect(address, 500);
    REQUIRE_FALSE(client.ok());
    const std::string message(client.status().message());
    INFO(message);
    const size_t first = message.find(address);
    CHECK(first != std::string::npos);
    CHECK(message.rfind(address) == first);
    return message;
  };
  const FakeDaemon refusing([](FakeServer& server, FakeCall& call) {
    server.ReplyError(call, Status(StatusCode::kInternal, "no"));
    return true;
  });
  CHECK(message_of(refusing.address()) == refusing.address() + ": no");
  FakeDaemon other_version;
  other_version.protocol_version = limits::kProtocolVersion + 1;
  message_of(other_version.address());
  message_of(SocketFolder().Address());  // where nobody is
}

TEST_CASE("a session that cannot be reached is given back") {
  FakeDaemon daemon;
  daemon.has_ports = false;
  Client client = ConnectTo(daemon);
  const Status refused = client.Make("Fake").status();
  CHECK(refused.code() == StatusCode::kUnavailable);
  CHECK(refused.message().find("the server offers no port") != std::string::npos);
  CHECK(daemon.closed_sessions() == 1);
}

TEST_CASE("sessions and datasets outlive their client") {
  FakeDaemon daemon;
  std::optional<Client> client = ConnectTo(daemon);
  Result<RemoteEnvironment> session = client->Make("Fake");
  Result<RemoteDataset> dataset = client->OpenDataset("Fake/tiny");
  REQUIRE((session.ok() && dataset.ok()));
  client.reset();
  CHECK(session->Reset().ok());
  CHECK(session->Step(kOneAction).ok());
  CHECK(dataset->Sample(2, 0, 0).ok());
  CHECK(session->Close().ok());
  CHECK(daemon.closed_sessions() == 1);
}

TEST_CASE("a closed session has nothing in flight, and says that it was closed") {
  FakeDaemon daemon([](FakeServer&, FakeCall& call) { return call.request.has_step(); });
  Client client = ConnectTo(daemon);
  Result<RemoteEnvironment> session = client.Make("Fake", {.num_envs = 2});
  REQUIRE(session.ok());
  const std::vector<uint32_t> lane1 = {1};
  REQUIRE(session->Send(kOneAction, lane1).ok());
  REQUIRE(session->Close().ok());
  CHECK(session->in_flight() == 0);
  const auto is_closed = [](const Status& status) {
    return status.code() == StatusCode::kFailedPrecondition &&
           status.message() == "the session was closed";
  };
  for (int i = 0; i < 2; ++i) {  // a refusal leaves no lane busy
    CHECK(is_closed(session->Step(kOneAction, lane1).status()));
    CHECK(is_closed(session->Reset().status()));
    CHECK(is_closed(session->Snapshot().status()));
    CHECK(is_closed(session->Render().status()));
    const std::vector<float> observation(kObservationSize);
    CHECK(is_closed(session->SendQuery(observation, kOneAction, 0, 0, 0).status()));
  }
  CHECK(session->Receive().status().code() == StatusCode::kFailedPrecondition);
  CHECK(session->Close().ok());
}

TEST_CASE("only the step limit is a time-out") {
  const std::array<uint8_t, 5> truncated = {0, 0, 1, 1, 1}, terminated = {0, 1, 0, 0, 0};
  const std::array causes = {Cause::kNone, Cause::kUnhealthy, Cause::kLimit, Cause::kCrash,
                             Cause::kNumericalError};
  StepOutcome outcome;
  outcome.truncated = truncated;
  outcome.terminated = terminated;
  outcome.causes = {reinterpret_cast<const uint8_t*>(causes.data()), causes.size()};
  for (size_t row = 0; row < causes.size(); ++row) {
    CAPTURE(row);
    CHECK(outcome.timed_out(row) == (causes[row] == Cause::kLimit));
  }
}

TEST_CASE("arrays that no daemon accepts are refused before they are sent") {
  FakeDaemon daemon;
  Client client = ConnectTo(daemon);
  Result<RemoteEnvironment> session = client.Make("Fake", {.num_envs = 0});
  REQUIRE(session.ok());
  const size_t rows = limits::kMaxPayloadBytes / (kObservationSize * sizeof(float)) + 1;
  const std::vector<float> observations(rows * kObservationSize), actions(rows * kActionSize);
  const Status status = session->SendQuery(observations, actions, 0, 0, 0).status();
  CHECK(status.code() == StatusCode::kInvalidArgument);
  CHECK(status.message().find(std::to_string(limits::kMaxPayloadBytes)) != std::string::npos);
}

TEST_CASE("a deadline of 0 is the default one, and no deadline is longer than may be") {
  std::vector<uint32_t> asked;
  FakeDaemon daemon([&asked](FakeServer&, FakeCall& call) {
    const bool counts = call.request.has_open() || call.request.has_open_dataset() ||
                        call.request.has_reset() || call.request.has_sample();
    if (counts) asked.push_back(call.request.deadline_ms());
    return false;
  });
  Client client = ConnectTo(daemon);
  constexpr int64_t kForever = std::numeric_limits<int64_t>::max();
  {
    Result<RemoteEnvironment> brief = client.Make("Fake", {.deadline_ms = 0});
    REQUIRE((brief.ok() && brief->Reset().ok()));
    Result<RemoteEnvironment> patient = client.Make("Fake", {.deadline_ms = kForever});
    REQUIRE((patient.ok() && patient->Reset().ok()));
    Result<RemoteDataset> data =
        client.OpenDataset("Fake/tiny", {.open_deadline_ms = kForever, .deadline_ms = 0});
    REQUIRE((data.ok() && data->Sample(2, 0, 0).ok()));
  }
  CHECK(Client::Connect(daemon.address(), 0).ok());
  CHECK(Client::Connect(daemon.address(), kForever).ok());
  const auto is_near = [](uint32_t sent, int64_t wanted) {
    return sent <= wanted && sent > wanted - 5'000;  // more than sending takes anywhere
  };
  REQUIRE(asked.size() == 6);
  for (const size_t i : {0, 1, 5}) CHECK(is_near(asked[i], limits::kDefaultDeadlineMs));
  for (const size_t i : {2, 3, 4}) CHECK(is_near(asked[i], limits::kMaxDeadlineMs));
}

TEST_CASE("a negative deadline is refused by name") {
  FakeDaemon daemon;
  Client client = ConnectTo(daemon);
  const auto is_refused = [](const Status& status, const std::string& name) {
    return status.code() == StatusCode::kInvalidArgument &&
           status.message().find(name) != std::string::npos &&
           status.message().find("-1") != std::string::npos;
  };
  CHECK(is_refused(client.Make("Fake", {.deadline_ms = -1}).status(), "deadline_ms"));
  CHECK(is_refused(client.OpenDataset("Fake/tiny", {.deadline_ms = -1}).status(), "deadline_ms"));
  CHECK(is_refused(client.OpenDataset("Fake/tiny", {.open_deadline_ms = -1}).status(),
                   "open_deadline_ms"));
  CHECK(is_refused(Client::Connect(daemon.address(), -1).status(), "deadline_ms"));
}

}  // namespace
}  // namespace b4mrl
