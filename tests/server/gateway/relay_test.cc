// Which requests the relay carries where, and what bounds them.
#include "server/gateway/relay.h"

#include <catch2/catch.hpp>
#include <map>

#include "proto/base/limits.h"
#include "tests/server/gateway/relay_fixture.h"

namespace b4mrl {
namespace {

TEST_CASE("Requests go to their session's worker, replies to the client that asked") {
  RelayFixture fixture;
  fixture.Open(Token('a'));
  fixture.Open(Token('b'));  // on the other worker
  REQUIRE(fixture.Forward("first", Query(7, Token('a'))).ok());
  REQUIRE(fixture.Forward("second", Query(7, Token('b'))).ok());
  REQUIRE(fixture.Forward("third", Query(8, Token('a'))).ok());
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
  for (const size_t i : {1, 2}) {
    const HandedBack& reply = fixture.handed_back[i];
    REQUIRE(reply.client == (reply.id == 7 ? "first" : "third"));
  }
  REQUIRE(fixture.relay->in_flight() == 0);
}

TEST_CASE("Requests about datasets need no token") {
  RelayFixture fixture;
  REQUIRE(fixture.Forward("client", Sample(1)).ok());
  const FakeCall call = fixture.Take(*fixture.dataset_worker);
  REQUIRE(call.request.has_sample());
  fixture.dataset_worker->Reply(call);
  fixture.AwaitReplies(1);
}

TEST_CASE("A token of no session is lost, and so is that of one that was closed") {
  RelayFixture fixture;
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
  RelayFixture fixture;
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

TEST_CASE("A session has a bound of requests and of bytes, and others have their own") {
  RelayFixture fixture;
  for (const char letter : {'a', 'b', 'c'}) fixture.Open(Token(letter));
  for (uint64_t id = 1; id <= limits::kMaxRequestsInFlight; ++id) {
    REQUIRE(fixture.Forward("greedy", Query(id, Token('a'))).ok());
  }
  const Status refused = fixture.Forward("greedy", Query(1'000, Token('a')));
  REQUIRE(refused.code() == StatusCode::kLimitExceeded);
  REQUIRE(refused.message().find("64") != std::string::npos);
  constexpr size_t kLarge = limits::kMaxPayloadBytes - 4'096;  // two of them fit into the bound
  REQUIRE(fixture.Forward("modest", Query(1, Token('b')), kLarge).ok());
  REQUIRE(fixture.Forward("modest", Query(2, Token('b')), kLarge).ok());
  REQUIRE(fixture.Forward("modest", Query(3, Token('b')), kLarge).code() ==
          StatusCode::kLimitExceeded);
  // A copy of what is on its way is not passed on then, but is no fault.
  for (int i = 0; i < 10; ++i) {
    REQUIRE(fixture.Forward("modest", Query(1, Token('b')), kLarge).ok());
  }
  REQUIRE(fixture.Forward("modest", Query(3, Token('b'))).ok());
  REQUIRE(fixture.Forward("third", Query(1, Token('c'))).ok());
}

TEST_CASE("All sessions together have a bound of bytes") {
  constexpr size_t kLarge = limits::kMaxPayloadBytes - 4'096;
  constexpr uint64_t kFitting = 4;
  RelayFixture fixture({.bytes = kFitting * limits::kMaxPayloadBytes});
  for (const char letter : {'a', 'b', 'c'}) fixture.Open(Token(letter));
  for (auto& worker : fixture.workers) worker.reset();  // nothing leaves, and no page is touched
  for (uint64_t i = 0; i < kFitting; ++i) {
    REQUIRE(fixture.Forward("client", Query(i, Token(i < 2 ? 'a' : 'b')), kLarge).ok());
  }
  REQUIRE(fixture.Forward("late", Query(1, Token('c')), kLarge).code() ==
          StatusCode::kLimitExceeded);
  REQUIRE(fixture.Forward("late", Query(1, Token('c'))).ok());
}

TEST_CASE("What nobody answers is forgotten after its deadline or its session's end") {
  RelayFixture fixture;
  fixture.Open(Token('a'));
  const uint32_t closed = fixture.Open(Token('b'));
  REQUIRE(fixture.Forward("client", Query(1, Token('a'), 1)).ok());
  REQUIRE(fixture.Forward("client", Query(2, Token('b'), limits::kMaxDeadlineMs)).ok());
  fixture.Close(closed);
  const Deadline deadline = Deadline::AfterMs(RelayFixture::kPatienceMs);
  while (fixture.relay->in_flight() > 0 && !deadline.expired()) fixture.PumpWhenReady();
  REQUIRE(fixture.relay->in_flight() == 0);
}

TEST_CASE("A client that has gone takes its requests with it") {
  RelayFixture fixture;
  fixture.Open(Token('a'));
  // Requests whose deadline is far away, so that they do not end by it.
  for (const uint64_t id : {1, 2}) {
    REQUIRE(fixture.Forward("client", Query(id, Token('a'), 600'000)).ok());
  }
  fixture.gone_clients.insert("client");
  fixture.workers[0]->Reply(fixture.Take(*fixture.workers[0]));
  const Deadline deadline = Deadline::AfterMs(RelayFixture::kPatienceMs);
  while (fixture.relay->in_flight() > 0 && !deadline.expired()) fixture.PumpWhenReady();
  REQUIRE(fixture.relay->in_flight() == 0);
}

TEST_CASE("A client that has gone takes its own requests with it, not those of others") {
  RelayFixture fixture;
  fixture.Open(Token('a'));
  for (const uint64_t id : {1, 2}) REQUIRE(fixture.Forward("gone", Query(id, Token('a'))).ok());
  REQUIRE(fixture.Forward("other", Query(3, Token('a'))).ok());
  fixture.gone_clients.insert("gone");
  std::vector<FakeCall> calls;
  for (int i = 0; i < 3; ++i) calls.push_back(fixture.Take(*fixture.workers[0]));
  fixture.workers[0]->Reply(calls[0]);
  const Deadline deadline = Deadline::AfterMs(RelayFixture::kPatienceMs);
  while (fixture.relay->in_flight() > 1 && !deadline.expired()) fixture.PumpWhenReady();
  REQUIRE(fixture.relay->in_flight() == 1);
  fixture.workers[0]->Reply(calls[2]);
  fixture.AwaitReplies(1);
  REQUIRE(fixture.handed_back[0].client == "other");
  REQUIRE(fixture.handed_back[0].id == 3);
}

TEST_CASE(
    "Routes are bounded: the idle one that was used longest ago makes room, busy ones do not") {
  constexpr size_t kRoutes = 8;
  RelayFixture fixture({.routes = kRoutes});
  const auto forward = [&](const RoutingId& client, uint64_t id) {
    return fixture.Forward(client, Sample(id)).code();
  };
  std::map<uint64_t, FakeCall> calls;
  const auto take = [&](uint64_t id) -> const FakeCall& {
    while (!calls.contains(id)) {
      FakeCall call = fixture.Take(*fixture.dataset_worker);
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
  for (const uint64_t id : {0, 1}) fixture.dataset_worker->Reply(take(id));
  fixture.AwaitReplies(2);
  uint64_t younger = 1;
  SECTION("in the order of their making") {}
  SECTION("in the other order") {
    younger = 0;
    REQUIRE(forward("client0", 20) == StatusCode::kOk);
    fixture.dataset_worker->Reply(take(20));
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
