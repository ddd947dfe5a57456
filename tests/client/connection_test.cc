#include "client/connection.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <catch2/catch.hpp>
#include <memory>

#include "tests/client/connection_fixture.h"

namespace b4mrl {
namespace {

TEST_CASE("replies are matched to their requests in any order") {
  ConnectionFixture fixture;
  const uint64_t first = fixture.Send("first");
  const uint64_t second = fixture.Send("second");
  const FakeCall first_call = fixture.Take();
  const FakeCall second_call = fixture.Take();
  fixture.server().Echo(second_call);
  fixture.server().Echo(first_call);
  CHECK(fixture.ReceiveText(first) == "first");
  CHECK(fixture.ReceiveText(second) == "second");
  CHECK(fixture.connection().in_flight() == 0);
}

TEST_CASE("the first answer of several wanted ones is received first") {
  ConnectionFixture fixture;
  const std::array ids = {fixture.Send("a"), fixture.Send("b"), fixture.Send("c")};
  const FakeCall a = fixture.Take();
  const FakeCall b = fixture.Take();
  const FakeCall c = fixture.Take();
  fixture.server().Echo(b);
  fixture.server().Echo(c);
  // b came first, but is not among the wanted ones.
  const std::array wanted = {ids[0], ids[2]};
  const Delivery delivery = fixture.connection().ReceiveAny(wanted);
  CHECK(delivery.id == ids[2]);
  CHECK(delivery.kind == Delivery::Kind::kReply);
  CHECK(fixture.ReceiveText(ids[1]) == "b");
}

TEST_CASE("a request carries the version, the token and the time that is left") {
  ConnectionFixture fixture;
  fixture.Send("x", 5'000);
  const pb::Request request = fixture.Take().request;
  CHECK(request.protocol_version() == limits::kProtocolVersion);
  CHECK(request.session_token() == "0123456789abcdef");
  CHECK(request.deadline_ms() <= 5'000);
  CHECK(request.deadline_ms() > 4'000);  // a second is far more than sending takes
}

TEST_CASE("a reply that comes twice is dropped") {
  ConnectionFixture fixture;
  const uint64_t first = fixture.Send("first");
  const FakeCall call = fixture.Take();
  fixture.server().Echo(call);
  fixture.server().Echo(call);
  CHECK(fixture.ReceiveText(first) == "first");
  const uint64_t second = fixture.Send("second");
  fixture.server().Echo(fixture.Take());
  CHECK(fixture.ReceiveText(second) == "second");
  CHECK(fixture.connection().in_flight() == 0);
}

TEST_CASE("a request that nobody answers ends at its deadline and its late reply is dropped") {
  ConnectionFixture fixture;
  const Clock::time_point start = Clock::now();
  const std::array ids = {fixture.Send("late", 200)};
  const FakeCall call = fixture.Take();
  const Delivery delivery = fixture.connection().ReceiveAny(ids);
  CHECK(SecondsSince(start) >= 0.2);
  CHECK(delivery.kind == Delivery::Kind::kNoAnswer);
  CHECK(delivery.reply.status().code() == StatusCode::kDeadlineExceeded);

  fixture.server().Echo(call);
  const uint64_t next = fixture.Send("next");
  std::optional<FakeCall> taken = fixture.server().Take();
  // Copies of the first request may come before the second one.
  while (taken && taken->request.request_id() != next) taken = fixture.server().Take();
  REQUIRE(taken.has_value());
  fixture.server().Echo(*taken);
  CHECK(fixture.ReceiveText(next) == "next");
  CHECK(fixture.connection().in_flight() == 0);
}

TEST_CASE("a wait ends when it is cancelled, and the session is closed all the same") {
  const SocketFolder folder;
  Context context;
  FakeServer server(folder.Address());
  std::atomic<bool> cancelled = false;
  Result<Connection> connection =
      Connection::Open(context, folder.Address(), "0123456789abcdef", &cancelled);
  REQUIRE(connection.ok());
  pb::Request request;
  request.mutable_hello();
  const auto id = connection->Send(std::move(request), Frame(), Deadline::AfterMs(kPatientMs));
  REQUIRE(id.ok());
  REQUIRE(server.Take().has_value());
  cancelled = true;
  // Without it, the answer that never comes is awaited for ten minutes.
  CHECK(connection->Receive(*id).status().code() == StatusCode::kUnavailable);
  CHECK(connection->in_flight() == 1);  // its id is known, so it may be received later
  pb::Request unknown;
  unknown.mutable_hello();
  CHECK(connection->Call(std::move(unknown), Frame(), Deadline::AfterMs(kPatientMs))
            .status()
            .code() == StatusCode::kUnavailable);
  CHECK(connection->in_flight() == 1);
  REQUIRE(server.Take().has_value());
  CHECK(connection->CloseSession(Deadline::AfterMs(10)).code() == StatusCode::kDeadlineExceeded);
  const std::optional<FakeCall> close = server.Take();
  REQUIRE(close.has_value());
  CHECK(close->request.has_close());

  Result<Connection> unreached =
      Connection::Open(context, folder.Address("nobody"), "", &cancelled);
  REQUIRE(unreached.ok());
  CHECK_FALSE(unreached->AwaitHandshake(Deadline::AfterMs(kPatientMs)));
}

TEST_CASE("a request with a string that is not UTF-8 is refused before it is sent") {
  ConnectionFixture fixture;
  CHECK(fixture.TrySend("caf\xe9").status().code() == StatusCode::kInvalidArgument);
  CHECK(fixture.connection().in_flight() == 0);
  const uint64_t id = fixture.Send("caf\xc3\xa9");
  fixture.server().Echo(fixture.Take());
  CHECK(fixture.ReceiveText(id) == "caf\xc3\xa9");
}

TEST_CASE("an address that is none, or that would never be reached, is refused") {
  Context context;
  for (const char* address : {"carrier-pigeon", "tcp://[::1]:7700"}) {
    CAPTURE(address);
    CHECK(Connection::Open(context, address, "").status().code() == StatusCode::kInvalidArgument);
  }
}

TEST_CASE("requests in flight are bounded") {
  ConnectionFixture fixture;
  std::vector<uint64_t> ids;
  for (uint32_t i = 0; i < limits::kMaxRequestsInFlight; ++i) ids.push_back(fixture.Send("x"));
  CHECK(fixture.TrySend("one too many").status().code() == StatusCode::kLimitExceeded);
  // An answer that nobody has received still counts.
  fixture.server().Echo(fixture.Take());
  fixture.server().Echo(fixture.Take());
  CHECK(fixture.ReceiveText(ids[1]) == "x");
  CHECK(fixture.TrySend("one more").ok());
  CHECK(fixture.TrySend("one too many").status().code() == StatusCode::kLimitExceeded);
  fixture.connection().Abandon(ids[0]);
  CHECK(fixture.TrySend("in place of the abandoned one").ok());
}

TEST_CASE("the reply to an abandoned request is dropped") {
  ConnectionFixture fixture;
  const uint64_t unwanted = fixture.Send("unwanted");
  const FakeCall call = fixture.Take();
  fixture.connection().Abandon(unwanted);
  fixture.server().Echo(call);
  const uint64_t wanted = fixture.Send("wanted");
  fixture.server().Echo(fixture.Take());
  CHECK(fixture.ReceiveText(wanted) == "wanted");
  CHECK(fixture.connection().in_flight() == 0);
  CHECK(fixture.connection().Receive(unwanted).status().code() == StatusCode::kFailedPrecondition);
}

TEST_CASE("a server's error comes back with its code and words") {
  ConnectionFixture fixture;
  const std::array ids = {fixture.Send("x")};
  fixture.server().ReplyError(fixture.Take(), InvalidArgument("colour", "blue", "red or green"));
  const Delivery delivery = fixture.connection().ReceiveAny(ids);
  CHECK(delivery.kind == Delivery::Kind::kRefused);
  CHECK(delivery.reply.status().code() == StatusCode::kInvalidArgument);
  CHECK(delivery.reply.status().message() == "colour is 'blue', allowed: red or green");
}

TEST_CASE("an error code of a newer server is internal and named") {
  ConnectionFixture fixture;
  const uint64_t id = fixture.Send("x");
  pb::Reply reply;
  reply.mutable_status()->set_code(4711);
  fixture.server().Reply(fixture.Take(), std::move(reply));
  const Status status = fixture.connection().Receive(id).status();
  CHECK(status.code() == StatusCode::kInternal);
  CHECK(status.message().find("4711") != std::string::npos);
}

TEST_CASE("a passing refusal of a request that was sent twice settles nothing") {
  ConnectionFixture fixture;
  const std::array ids = {fixture.Send("x", 8'000)};
  (void)fixture.Take();
  std::thread server([&fixture] {
    if (const std::optional<FakeCall> again = fixture.server().Take()) {
      fixture.server().ReplyError(*again, Status(StatusCode::kBusy, "still at the first copy"));
    }
  });
  const Delivery delivery = fixture.connection().ReceiveAny(ids);
  server.join();
  CHECK(delivery.kind == Delivery::Kind::kNoAnswer);
  CHECK(delivery.reply.status().code() == StatusCode::kBusy);
}

TEST_CASE("a reply whose arrays reach beyond its payload is no answer") {
  ConnectionFixture fixture;
  const std::array ids = {fixture.Send("x")};
  pb::Reply reply;
  ArrayLayout layout(reply.mutable_arrays());
  layout.Add("observations", DType::kFloat32, {4, 17});
  fixture.server().Reply(fixture.Take(), std::move(reply), Frame::Copy("short"));
  const Delivery delivery = fixture.connection().ReceiveAny(ids);
  CHECK(delivery.kind == Delivery::Kind::kNoAnswer);
  CHECK(delivery.reply.status().code() == StatusCode::kInternal);
}

TEST_CASE("noise on the wire is passed over") {
  ConnectionFixture fixture;
  const uint64_t id = fixture.Send("x");
  const FakeCall call = fixture.Take();
  fixture.server().Send(call, {Frame::Copy("\xff\xff\xff no protobuf"), Frame()});
  fixture.server().Send(call, {Frame(), Frame::Copy("payload without an envelope")});
  fixture.server().Echo(call);
  CHECK(fixture.ReceiveText(id) == "x");
}

TEST_CASE("A refusal without an id answers the only request that is under way") {
  ConnectionFixture fixture;
  const uint64_t id = fixture.Send("x");
  FakeCall call = fixture.Take();
  call.request.set_request_id(0);
  fixture.server().ReplyError(call, Status(StatusCode::kInvalidArgument, "cannot be read"));
  CHECK(fixture.connection().Receive(id).status().code() == StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace b4mrl
