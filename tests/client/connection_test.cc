#include "client/connection.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <catch2/catch.hpp>
#include <memory>

#include "tests/client/fake_server.h"

namespace b4mrl {
namespace {

constexpr int64_t kPatientMs = 600'000;  // an eighth is longer than FakeServer::Take waits

class Fixture {
 public:
  Fixture() : server_(std::make_unique<FakeServer>(folder_.Address())) {
    Result<Connection> connection =
        Connection::Open(context_, folder_.Address(), "0123456789abcdef");
    REQUIRE(connection.ok());
    connection_ = std::make_unique<Connection>(std::move(*connection));
  }

  FakeServer& server() { return *server_; }
  Connection& connection() { return *connection_; }
  const SocketFolder& folder() const { return folder_; }
  void KillServer() { server_.reset(); }

  Result<uint64_t> TrySend(const std::string& text, int64_t deadline_ms = kPatientMs,
                           Frame payload = {}) {
    pb::Request request;
    request.mutable_hello()->set_client(text);
    return connection_->Send(std::move(request), std::move(payload),
                             Deadline::AfterMs(deadline_ms));
  }
  uint64_t Send(const std::string& text, int64_t deadline_ms = kPatientMs, Frame payload = {}) {
    const Result<uint64_t> id = TrySend(text, deadline_ms, std::move(payload));
    REQUIRE(id.ok());
    return *id;
  }
  FakeCall Take() {
    std::optional<FakeCall> call = server_->Take();
    REQUIRE(call.has_value());
    return std::move(*call);
  }
  std::string ReceiveText(uint64_t id) {
    Result<ReceivedReply> reply = connection_->Receive(id);
    INFO(reply.status().ToString());
    REQUIRE(reply.ok());
    return reply->envelope.hello().server_version();
  }

 private:
  SocketFolder folder_;
  Context context_;
  std::unique_ptr<FakeServer> server_;
  std::unique_ptr<Connection> connection_;
};

// The bytes that must not differ between two copies of a request.
std::string WithoutDeadline(const FakeCall& call) {
  pb::Request request = call.request;
  request.clear_deadline_ms();
  return request.SerializeAsString() + std::string(call.payload.view());
}

TEST_CASE("replies are matched to their requests in any order") {
  Fixture fixture;
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
  Fixture fixture;
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
  Fixture fixture;
  fixture.Send("x", 5'000);
  const pb::Request request = fixture.Take().request;
  CHECK(request.protocol_version() == limits::kProtocolVersion);
  CHECK(request.session_token() == "0123456789abcdef");
  CHECK(request.deadline_ms() <= 5'000);
  CHECK(request.deadline_ms() > 4'000);  // a second is far more than sending takes
}

TEST_CASE("a reply that comes twice is dropped") {
  Fixture fixture;
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
  Fixture fixture;
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
  Fixture fixture;
  CHECK(fixture.TrySend("caf\xe9").status().code() == StatusCode::kInvalidArgument);
  CHECK(fixture.connection().in_flight() == 0);
  const uint64_t id = fixture.Send("caf\xc3\xa9");
  fixture.server().Echo(fixture.Take());
  CHECK(fixture.ReceiveText(id) == "caf\xc3\xa9");
}

TEST_CASE("an address that is none is refused") {
  Context context;
  CHECK(Connection::Open(context, "carrier-pigeon", "").status().code() ==
        StatusCode::kInvalidArgument);
}

TEST_CASE("after a reconnection every unanswered request is sent again, unchanged but for time") {
  Fixture fixture;
  const uint64_t answered = fixture.Send("answered");
  const uint64_t lost = fixture.Send("lost", kPatientMs, Frame::Copy(std::string(1000, 'p')));
  const uint64_t also_lost = fixture.Send("also lost");
  fixture.server().Echo(fixture.Take());
  CHECK(fixture.ReceiveText(answered) == "answered");
  const std::array before = {fixture.Take(), fixture.Take()};
  fixture.KillServer();

  std::vector<FakeCall> after;
  std::thread replacement([&fixture, &after] {
    FakeServer server(fixture.folder().Address());
    for (int i = 0; i < 2; ++i) {
      std::optional<FakeCall> call = server.Take();
      if (!call) return;
      after.push_back(std::move(*call));
    }
    for (const FakeCall& call : after) server.Echo(call);
    // Lets the replies leave before the socket closes; nothing else is to come.
    if (std::optional<FakeCall> surplus = server.Take(200)) after.push_back(std::move(*surplus));
  });
  const std::string first_text = fixture.ReceiveText(lost);
  const std::string second_text = fixture.ReceiveText(also_lost);
  replacement.join();
  CHECK(first_text == "lost");
  CHECK(second_text == "also lost");
  REQUIRE(after.size() == 2);
  for (size_t i = 0; i < 2; ++i) {
    CHECK(WithoutDeadline(after[i]) == WithoutDeadline(before[i]));
    CHECK(after[i].request.deadline_ms() <= before[i].request.deadline_ms());
  }
  CHECK(fixture.connection().connections() >= 2);
}

// The outcome of a request that a server answers only after its deadline, over a new connection.
Status AnswerOverdue(int64_t deadline_ms) {
  Fixture fixture;
  const uint64_t lost = fixture.Send("lost", deadline_ms);
  const Deadline deadline = Deadline::AfterMs(deadline_ms);
  const FakeCall before = fixture.Take();
  fixture.KillServer();
  FakeServer replacement(fixture.folder().Address());
  while (fixture.connection().connections() < 2 || !deadline.expired()) {
    REQUIRE_FALSE(replacement.Take(20).has_value());  // the caller is busy elsewhere
  }
  std::thread answer([&replacement, &before] {
    const std::optional<FakeCall> call = replacement.Take();
    if (call && WithoutDeadline(*call) == WithoutDeadline(before)) replacement.Echo(*call);
  });
  const Result<ReceivedReply> reply = fixture.connection().Receive(lost);
  answer.join();
  return reply.status();
}

TEST_CASE("a deadline that passed while nobody waited does not end what a reconnection lost") {
  // An eighth of the deadline is left for an echo. On a machine that stalls for longer, a longer
  // deadline has to show it.
  Status status = AnswerOverdue(1'600);
  for (const int64_t deadline_ms : {6'400, 25'600}) {
    if (!status.ok()) status = AnswerOverdue(deadline_ms);
  }
  CHECK(status.ToString() == "OK");
}

TEST_CASE("a request is sent again after an eighth of its deadline in silence") {
  Fixture fixture;
  constexpr int64_t kDeadlineMs = 4'000;
  double silence = 0;
  std::string first_copy;
  std::string second_copy;
  const uint64_t id = fixture.Send("quiet", kDeadlineMs);
  const FakeCall call = fixture.Take();
  const Clock::time_point taken = Clock::now();
  std::thread server([&] {
    const std::optional<FakeCall> again = fixture.server().Take();
    silence = SecondsSince(taken);
    if (!again) return;
    second_copy = WithoutDeadline(*again);
    fixture.server().Echo(*again);
  });
  const std::string text = fixture.ReceiveText(id);
  server.join();
  CHECK(text == "quiet");
  CHECK(second_copy == WithoutDeadline(call));
  // It was taken a little after it was sent.
  CHECK(silence > 0.8 * kDeadlineMs / 8 / 1000);
}

TEST_CASE("a slow request is not sent again while others are answered") {
  Fixture fixture;
  constexpr int64_t kSlowDeadlineMs = 8'000;
  constexpr double kPatienceSeconds = kSlowDeadlineMs / 8 / 1000.0;
  const uint64_t slow = fixture.Send("slow", kSlowDeadlineMs);
  const FakeCall slow_call = fixture.Take();
  const Clock::time_point start = Clock::now();
  double longest_gap = 0;
  int copies = 1;
  while (SecondsSince(start) < 1.5 * kPatienceSeconds) {
    const Clock::time_point asked = Clock::now();
    const uint64_t quick = fixture.Send("quick");
    FakeCall call = fixture.Take();
    while (call.request.request_id() != quick) {
      ++copies;
      call = fixture.Take();
    }
    fixture.server().Echo(call);
    CHECK(fixture.ReceiveText(quick) == "quick");
    longest_gap = std::max(longest_gap, SecondsSince(asked));
  }
  fixture.server().Echo(slow_call);
  CHECK(fixture.ReceiveText(slow) == "slow");
  // On a machine that stalls the test for that long, the silence was real.
  if (longest_gap < kPatienceSeconds) CHECK(copies == 1);
}

TEST_CASE("requests in flight are bounded") {
  Fixture fixture;
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
  Fixture fixture;
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
  Fixture fixture;
  const std::array ids = {fixture.Send("x")};
  fixture.server().ReplyError(fixture.Take(), InvalidArgument("colour", "blue", "red or green"));
  const Delivery delivery = fixture.connection().ReceiveAny(ids);
  CHECK(delivery.kind == Delivery::Kind::kRefused);
  CHECK(delivery.reply.status().code() == StatusCode::kInvalidArgument);
  CHECK(delivery.reply.status().message() == "colour is 'blue', allowed: red or green");
}

TEST_CASE("an error code of a newer server is internal and named") {
  Fixture fixture;
  const uint64_t id = fixture.Send("x");
  pb::Reply reply;
  reply.mutable_status()->set_code(4711);
  fixture.server().Reply(fixture.Take(), std::move(reply));
  const Status status = fixture.connection().Receive(id).status();
  CHECK(status.code() == StatusCode::kInternal);
  CHECK(status.message().find("4711") != std::string::npos);
}

TEST_CASE("a passing refusal of a request that was sent twice settles nothing") {
  Fixture fixture;
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
  Fixture fixture;
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
  Fixture fixture;
  const uint64_t id = fixture.Send("x");
  const FakeCall call = fixture.Take();
  fixture.server().Send(call, {Frame::Copy("\xff\xff\xff no protobuf"), Frame()});
  fixture.server().Send(call, {Frame(), Frame::Copy("payload without an envelope")});
  fixture.server().Echo(call);
  CHECK(fixture.ReceiveText(id) == "x");
}

TEST_CASE("A refusal without an id answers the only request that is under way") {
  Fixture fixture;
  const uint64_t id = fixture.Send("x");
  FakeCall call = fixture.Take();
  call.request.set_request_id(0);
  fixture.server().ReplyError(call, Status(StatusCode::kInvalidArgument, "cannot be read"));
  CHECK(fixture.connection().Receive(id).status().code() == StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace b4mrl
