// The relay between sockets that the test holds: it plays the processes and the gateway's clients.
#include "server/gateway/relay.h"

#include <catch2/catch.hpp>
#include <map>

#include "proto/base/limits.h"
#include "tests/client/fake_server.h"

namespace b4mrl {
namespace {

constexpr int64_t kPatienceMs = 20'000;
constexpr uint32_t kWorkers = 2;

std::string Token(char letter) { return std::string(limits::kTokenBytes, letter); }

pb::Request Query(uint64_t id, const std::string& token, uint32_t deadline_ms = 10'000) {
  pb::Request request;
  request.set_protocol_version(limits::kProtocolVersion);
  request.set_request_id(id);
  request.set_session_token(token);
  request.set_deadline_ms(deadline_ms);
  request.mutable_query()->set_seed(id);
  return request;
}

pb::Request Sample(uint64_t id) {
  pb::Request request = Query(id, "");
  request.mutable_sample()->set_rows(1);
  return request;
}

struct HandedBack {
  RoutingId client;
  uint64_t id;
};

class Fixture {
  SocketFolder folder_;
  Context sockets_;  // outlives the relay
  SharedState state_;
  SessionTable table_;

 public:
  explicit Fixture(Relay::Limits relayed = {})
      : state_(std::move(*SharedState::Create(kWorkers, 1'000))), table_(state_) {
    Relay::Addresses addresses;
    for (uint32_t i = 0; i < kWorkers; ++i) addresses.workers.push_back(WorkerAddress(i));
    addresses.dataset_worker = folder_.Address("dataset");
    for (uint32_t i = 0; i < kWorkers; ++i) Restart(i);
    dataset_worker = std::make_unique<FakeServer>(addresses.dataset_worker);
    relay = std::make_unique<Relay>(
        sockets_, state_, addresses,
        [this](const RoutingId& client, Message reply) { return HandBack(client, reply); },
        relayed);
  }

  std::unique_ptr<FakeServer> workers[kWorkers];
  std::unique_ptr<FakeServer> dataset_worker;
  std::unique_ptr<Relay> relay;
  std::vector<HandedBack> handed_back;
  std::set<RoutingId> gone_clients;

  // A new process behind the same address; what the old one held is lost.
  void Restart(uint32_t worker) {
    workers[worker].reset();
    workers[worker] = std::make_unique<FakeServer>(WorkerAddress(worker));
  }
  // A live session on the worker with the fewest lanes: the first one on worker 0.
  uint32_t Open(const std::string& token) {
    const Result<uint32_t> index = table_.Allocate({token, "request", 1, 1});
    REQUIRE(index.ok());
    table_.MakeLive(*index);
    return *index;
  }
  void Close(uint32_t session) {
    state_.session(session).Close(state_.session(session).generation);
  }

  Status Forward(const RoutingId& client, const pb::Request& request, size_t payload_bytes = 0) {
    Frame payload = payload_bytes == 0 ? Frame() : Frame::OfSize(payload_bytes);
    return relay->Forward(client, request,
                          {Frame::Copy(request.SerializeAsString()), std::move(payload)});
  }
  // Pumps until `process` has a request.
  FakeCall Take(FakeServer& process) {
    const Deadline deadline = Deadline::AfterMs(kPatienceMs);
    while (!deadline.expired()) {
      relay->Pump();
      if (std::optional<FakeCall> call = process.Take(1)) return std::move(*call);
    }
    FAIL("nothing arrived");
    return {};
  }
  // Pumps until `count` replies have been handed back.
  void AwaitReplies(size_t count) {
    const Deadline deadline = Deadline::AfterMs(kPatienceMs);
    while (handed_back.size() < count && !deadline.expired()) PumpWhenReady();
    REQUIRE(handed_back.size() == count);
  }
  void PumpWhenReady() {
    std::vector<void*> sockets;
    relay->AppendSockets(&sockets);
    WaitAnyReadable(sockets, 1);
    relay->Pump();
  }

 private:
  std::string WorkerAddress(uint32_t i) const {
    return folder_.Address("worker-" + std::to_string(i));
  }
  Status HandBack(const RoutingId& client, const Message& reply) {
    if (gone_clients.contains(client)) return {StatusCode::kUnavailable, "gone"};
    pb::Reply envelope;
    REQUIRE(ParseEnvelope(reply.envelope, &envelope).ok());
    handed_back.push_back({client, envelope.request_id()});
    return Status();
  }
};

TEST_CASE("Requests go to their session's worker, replies to the client that asked") {
  Fixture fixture;
  fixture.Open(Token('a'));
  fixture.Open(Token('b'));  // on the other worker
  REQUIRE(fixture.Forward("first", Query(7, Token('a'))).ok());
  REQUIRE(fixture.Forward("second", Query(7, Token('b'))).ok());
  REQUIRE(fixture.Forward("third", Query(7, Token('a'))).ok());
  REQUIRE(fixture.relay->in_flight() == 3);
  FakeCall b = fixture.Take(*fixture.workers[1]);
  REQUIRE(b.request.session_token() == Token('b'));
  fixture.workers[1]->Reply(b);
  fixture.AwaitReplies(1);
  REQUIRE(fixture.handed_back[0].client == "second");
  REQUIRE(fixture.handed_back[0].id == 7);
  // The same session from two connections: each reply finds its own.
  for (int i = 0; i < 2; ++i) {
    const FakeCall call = fixture.Take(*fixture.workers[0]);
    fixture.workers[0]->Reply(call);
  }
  fixture.AwaitReplies(3);
  REQUIRE(fixture.handed_back[1].client != fixture.handed_back[2].client);
  REQUIRE(fixture.relay->in_flight() == 0);
}

TEST_CASE("Requests about datasets need no token") {
  Fixture fixture;
  REQUIRE(fixture.Forward("client", Sample(1)).ok());
  const FakeCall call = fixture.Take(*fixture.dataset_worker);
  REQUIRE(call.request.has_sample());
  fixture.dataset_worker->Reply(call);
  fixture.AwaitReplies(1);
}

TEST_CASE("A token of no session is lost, and so is that of one that was closed") {
  Fixture fixture;
  REQUIRE(fixture.Forward("client", Query(1, Token('a'))).code() == StatusCode::kSessionLost);
  REQUIRE(fixture.Forward("client", Query(1, "")).code() == StatusCode::kSessionLost);
  const uint32_t session = fixture.Open(Token('a'));
  REQUIRE(fixture.Forward("client", Query(1, Token('a'))).ok());
  fixture.Close(session);
  REQUIRE(fixture.Forward("client", Query(2, Token('a'))).code() == StatusCode::kSessionLost);
  // What was under way is still answered.
  fixture.workers[0]->Reply(fixture.Take(*fixture.workers[0]));
  fixture.AwaitReplies(1);
}

TEST_CASE("What a replaced process held is sent again with the time that is left") {
  Fixture fixture;
  fixture.Open(Token('a'));
  REQUIRE(fixture.Forward("client", Query(1, Token('a')), 100).ok());
  REQUIRE(fixture.Forward("client", Query(2, Token('a'))).ok());
  fixture.workers[0]->Reply(fixture.Take(*fixture.workers[0]));
  fixture.AwaitReplies(1);
  const FakeCall lost = fixture.Take(*fixture.workers[0]);
  fixture.Restart(0);
  const FakeCall again = fixture.Take(*fixture.workers[0]);
  REQUIRE(again.request.request_id() == lost.request.request_id());
  REQUIRE(again.request.deadline_ms() < lost.request.deadline_ms());
  REQUIRE(again.request.deadline_ms() > 0);
  pb::Request unchanged = again.request;
  unchanged.set_deadline_ms(lost.request.deadline_ms());
  REQUIRE(unchanged.SerializeAsString() == lost.request.SerializeAsString());
  fixture.workers[0]->Reply(again);
  fixture.AwaitReplies(2);
  REQUIRE(fixture.relay->in_flight() == 0);
}

TEST_CASE("A refusal of what the relay has sent again does not pass for 'not executed'") {
  Fixture fixture;
  fixture.Open(Token('a'));
  REQUIRE(fixture.Forward("client", Query(1, Token('a'))).ok());
  fixture.Take(*fixture.workers[0]);  // and may have executed it
  fixture.Restart(0);
  fixture.workers[0]->ReplyError(fixture.Take(*fixture.workers[0]),
                                 Status(StatusCode::kLimitExceeded, "no room"));
  const Deadline deadline = Deadline::AfterMs(kPatienceMs);
  while (fixture.relay->in_flight() > 0 && !deadline.expired()) fixture.PumpWhenReady();
  REQUIRE(fixture.relay->in_flight() == 0);
  REQUIRE(fixture.handed_back.empty());
  // The client asks again, and learns what became of it.
  REQUIRE(fixture.Forward("client", Query(1, Token('a'))).ok());
  fixture.workers[0]->Reply(fixture.Take(*fixture.workers[0]));
  fixture.AwaitReplies(1);
  // What was sent once is refused as ever.
  REQUIRE(fixture.Forward("client", Query(2, Token('a'))).ok());
  fixture.workers[0]->ReplyError(fixture.Take(*fixture.workers[0]),
                                 Status(StatusCode::kLimitExceeded, "no room"));
  fixture.AwaitReplies(2);
}

TEST_CASE("A copy of a request is passed on, and counts as the same one") {
  Fixture fixture;
  fixture.Open(Token('a'));
  for (int i = 0; i < 3; ++i) {
    REQUIRE(fixture.Forward("client", Query(1, Token('a'), 600'000)).ok());
  }
  REQUIRE(fixture.relay->in_flight() == 1);
  for (int i = 0; i < 3; ++i) fixture.workers[0]->Reply(fixture.Take(*fixture.workers[0]));
  // The first reply settles it. Others are for the client to drop, if they come along with that
  // one.
  const Deadline deadline = Deadline::AfterMs(kPatienceMs);
  while (fixture.relay->in_flight() > 0 && !deadline.expired()) fixture.PumpWhenReady();
  REQUIRE(fixture.relay->in_flight() == 0);
  REQUIRE_FALSE(fixture.handed_back.empty());
}

TEST_CASE("A connection has a bound of requests and of bytes, and others have their own") {
  Fixture fixture;
  fixture.Open(Token('a'));
  for (uint64_t id = 1; id <= limits::kMaxRequestsInFlight; ++id) {
    REQUIRE(fixture.Forward("greedy", Query(id, Token('a'))).ok());
  }
  const Status refused = fixture.Forward("greedy", Query(1'000, Token('a')));
  REQUIRE(refused.code() == StatusCode::kLimitExceeded);
  REQUIRE(refused.message().find("64") != std::string::npos);
  constexpr size_t kLarge = limits::kMaxPayloadBytes - 4'096;  // two of them fit into the bound
  REQUIRE(fixture.Forward("modest", Query(1, Token('a')), kLarge).ok());
  REQUIRE(fixture.Forward("modest", Query(2, Token('a')), kLarge).ok());
  REQUIRE(fixture.Forward("modest", Query(3, Token('a')), kLarge).code() ==
          StatusCode::kLimitExceeded);
  // A copy of what is on its way is not passed on then, but is no fault.
  for (int i = 0; i < 10; ++i) {
    REQUIRE(fixture.Forward("modest", Query(1, Token('a')), kLarge).ok());
  }
  REQUIRE(fixture.Forward("modest", Query(3, Token('a'))).ok());
  REQUIRE(fixture.Forward("third", Query(1, Token('a'))).ok());
}

TEST_CASE("All connections together have a bound of bytes") {
  constexpr size_t kLarge = limits::kMaxPayloadBytes - 4'096;
  constexpr uint64_t kFitting = 4;
  Fixture fixture({.bytes = kFitting * limits::kMaxPayloadBytes});
  fixture.Open(Token('a'));
  fixture.workers[0].reset();  // so that nothing leaves, and no page is touched
  for (uint64_t i = 0; i < kFitting; ++i) {
    const RoutingId client = "client" + std::to_string(i / 2);
    REQUIRE(fixture.Forward(client, Query(i, Token('a')), kLarge).ok());
  }
  REQUIRE(fixture.Forward("late", Query(1, Token('a')), kLarge).code() ==
          StatusCode::kLimitExceeded);
  REQUIRE(fixture.Forward("late", Query(1, Token('a'))).ok());
}

TEST_CASE("What nobody answers is forgotten after its deadline") {
  Fixture fixture;
  fixture.Open(Token('a'));
  REQUIRE(fixture.Forward("client", Query(1, Token('a'), 1)).ok());
  const Deadline deadline = Deadline::AfterMs(kPatienceMs);
  while (fixture.relay->in_flight() > 0 && !deadline.expired()) fixture.PumpWhenReady();
  REQUIRE(fixture.relay->in_flight() == 0);
}

TEST_CASE("A client that has gone takes its requests with it") {
  Fixture fixture;
  fixture.Open(Token('a'));
  // Requests whose deadline is far away, so that they do not end by it.
  for (const uint64_t id : {1, 2}) {
    REQUIRE(fixture.Forward("client", Query(id, Token('a'), 600'000)).ok());
  }
  fixture.gone_clients.insert("client");
  fixture.workers[0]->Reply(fixture.Take(*fixture.workers[0]));
  const Deadline deadline = Deadline::AfterMs(kPatienceMs);
  while (fixture.relay->in_flight() > 0 && !deadline.expired()) fixture.PumpWhenReady();
  REQUIRE(fixture.relay->in_flight() == 0);
}

TEST_CASE("The bytes of copies are given back with those of the request") {
  Fixture fixture;
  fixture.Open(Token('a'));
  // Copies may take half of the bound: three of them with their request here.
  constexpr size_t kPart = limits::kMaxRelayRouteBytes / 8 - 4'096;
  constexpr size_t kLarge = limits::kMaxPayloadBytes - 4'096;
  for (int i = 0; i < 9; ++i) REQUIRE(fixture.Forward("client", Query(1, Token('a')), kPart).ok());
  REQUIRE(fixture.Forward("client", Query(2, Token('a')), kLarge).ok());
  REQUIRE(fixture.Forward("client", Query(3, Token('a')), kPart).code() ==
          StatusCode::kLimitExceeded);
  fixture.workers[0]->Reply(fixture.Take(*fixture.workers[0]));
  fixture.AwaitReplies(1);
  for (uint64_t id = 3; id <= 6; ++id) {
    REQUIRE(fixture.Forward("client", Query(id, Token('a')), kPart).ok());
  }
}

TEST_CASE(
    "Routes are bounded: the idle one that was used longest ago makes room, busy ones do not") {
  constexpr size_t kRoutes = 8;
  Fixture fixture({.routes = kRoutes});
  fixture.Open(Token('a'));
  const auto forward = [&](const RoutingId& client, uint64_t id) {
    return fixture.Forward(client, Query(id, Token('a'))).code();
  };
  std::map<uint64_t, FakeCall> calls;
  const auto take = [&](uint64_t id) -> const FakeCall& {
    while (!calls.contains(id)) {
      FakeCall call = fixture.Take(*fixture.workers[0]);
      const uint64_t taken = call.request.request_id();
      calls[taken] = std::move(call);
    }
    return calls[id];
  };
  for (uint64_t i = 0; i < kRoutes; ++i) {
    REQUIRE(forward("client" + std::to_string(i), i) == StatusCode::kOk);
  }
  REQUIRE(forward("late", 10) == StatusCode::kLimitExceeded);
  REQUIRE(fixture.relay->in_flight() == kRoutes);
  for (const uint64_t id : {0, 1}) fixture.workers[0]->Reply(take(id));
  fixture.AwaitReplies(2);
  uint64_t younger = 1;
  SECTION("in the order of their making") {}
  SECTION("in the other order") {
    younger = 0;
    REQUIRE(forward("client0", 20) == StatusCode::kOk);
    fixture.workers[0]->Reply(take(20));
    fixture.AwaitReplies(3);
  }
  REQUIRE(forward("late", 10) == StatusCode::kOk);
  // The younger one still has its connection.
  REQUIRE(forward("client" + std::to_string(younger), 30) == StatusCode::kOk);
  CHECK(take(30).sender == take(younger).sender);
  REQUIRE(forward("later", 40) == StatusCode::kLimitExceeded);
}

}  // namespace
}  // namespace b4mrl
