// What the relay makes of requests that are sent more than once, by clients or by itself.
#include "server/gateway/relay.h"

#include <catch2/catch.hpp>
#include <string>

#include "proto/base/limits.h"
#include "tests/server/gateway/relay_fixture.h"

namespace b4mrl {
namespace {

TEST_CASE("A refusal of what the relay has sent again does not pass for 'not executed'") {
  RelayFixture fixture;
  fixture.Open(Token('a'));
  REQUIRE(fixture.Forward("client", Query(1, Token('a'))).ok());
  fixture.Take(*fixture.workers[0]);  // and may have executed it
  fixture.Restart(0);
  fixture.workers[0]->ReplyError(fixture.Take(*fixture.workers[0]),
                                 Status(StatusCode::kLimitExceeded, "no room"));
  const Deadline deadline = Deadline::AfterMs(RelayFixture::kPatienceMs);
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
  RelayFixture fixture;
  fixture.Open(Token('a'));
  for (int i = 0; i < 3; ++i) {
    REQUIRE(fixture.Forward("client", Query(1, Token('a'), 600'000)).ok());
  }
  REQUIRE(fixture.relay->in_flight() == 1);
  for (int i = 0; i < 3; ++i) fixture.workers[0]->Reply(fixture.Take(*fixture.workers[0]));
  // The first reply settles it. Others are for the client to drop, if they come along with that
  // one.
  const Deadline deadline = Deadline::AfterMs(RelayFixture::kPatienceMs);
  while (fixture.relay->in_flight() > 0 && !deadline.expired()) fixture.PumpWhenReady();
  REQUIRE(fixture.relay->in_flight() == 0);
  REQUIRE_FALSE(fixture.handed_back.empty());
}

TEST_CASE("A request whose copies come over many connections is carried once, for the last one") {
  constexpr size_t kConnections = 20;
  constexpr size_t kLarge = limits::kMaxPayloadBytes / 8 - 4'096;
  RelayFixture fixture({.bytes = limits::kMaxPayloadBytes / 2, .routes = 2});
  fixture.Open(Token('a'));
  fixture.Open(Token('b'));
  const auto last = "client" + std::to_string(kConnections);
  for (size_t i = 1; i <= kConnections; ++i) {
    const RoutingId client = "client" + std::to_string(i);
    REQUIRE(fixture.Forward(client, Query(1, Token('a'), 600'000), kLarge).ok());
    if (client != last) fixture.gone_clients.insert(client);
  }
  REQUIRE(fixture.relay->in_flight() == 1);
  // The worker answers once.
  fixture.workers[0]->Reply(fixture.Take(*fixture.workers[0]));
  fixture.AwaitReplies(1);
  REQUIRE(fixture.handed_back[0].client == last);
  REQUIRE(fixture.relay->in_flight() == 0);
  // Nothing of the copies keeps others out.
  for (uint64_t id = 1; id <= 4; ++id) {
    REQUIRE(fixture.Forward("other", Query(id, Token('b')), kLarge).ok());
  }
}

TEST_CASE("A second connection's request is no copy if it says something else under the same id") {
  RelayFixture fixture;
  fixture.Open(Token('a'));
  const auto forward = [&](const RoutingId& client, uint64_t seed, const std::string& payload) {
    pb::Request request = Query(1, Token('a'));
    request.mutable_query()->set_seed(seed);
    return fixture.relay->Forward(client, request,
                                  {Frame::Copy(request.SerializeAsString()), Frame::Copy(payload)});
  };
  REQUIRE(forward("first", 1, "abc").ok());
  REQUIRE(forward("second", 2, "abc").code() == StatusCode::kInvalidArgument);
  REQUIRE(forward("second", 1, "abd").code() == StatusCode::kInvalidArgument);
  fixture.workers[0]->Reply(fixture.Take(*fixture.workers[0]));
  fixture.AwaitReplies(1);
  REQUIRE(fixture.handed_back[0].client == "first");
}

TEST_CASE("The bytes of copies are given back with those of the request") {
  RelayFixture fixture;
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

}  // namespace
}  // namespace b4mrl
