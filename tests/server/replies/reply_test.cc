// What every server does with every message: it reads it, and answers it once.
#include "server/replies/reply.h"

#include <catch2/catch.hpp>
#include <string>
#include <vector>

#include "proto/base/limits.h"

namespace b4mrl {
namespace {

class Replies {
 public:
  std::atomic<uint64_t> requests = 0, errors = 0;
  struct Sent {
    RoutingId receiver;
    pb::Reply reply;
    std::string payload;
  };
  std::vector<Sent> sent;
  Responder responder{{requests, errors}, [this](const RoutingId& receiver, Message message) {
                        Sent one{receiver, {}, std::string(message.payload.view())};
                        REQUIRE(ParseEnvelope(message.envelope, &one.reply).ok());
                        sent.push_back(std::move(one));
                      }};

  std::optional<Asker> Read(const std::string& envelope, pb::Request* request) {
    return responder.Read({"client", {Frame::Copy(envelope), Frame()}}, request);
  }
};

StatusCode CodeOf(const pb::Reply& reply) { return GetStatus(reply.status()).code(); }

TEST_CASE("A sound request is handed over, and its sender and id with it") {
  Replies replies;
  pb::Request sound, read;
  sound.set_protocol_version(limits::kProtocolVersion);
  sound.set_request_id(7);
  sound.mutable_hello()->set_client("test");
  read.mutable_step();  // of an earlier message
  const std::optional<Asker> asker = replies.Read(sound.SerializeAsString(), &read);
  REQUIRE(asker);
  CHECK(asker->peer == "client");
  CHECK(asker->request_id == 7);
  CHECK(read.hello().client() == "test");
  CHECK(replies.sent.empty());
  CHECK(replies.requests == 1);
  CHECK(replies.errors == 0);
}

TEST_CASE("What cannot be read, or is of another version, is answered on the spot") {
  Replies replies;
  pb::Request read, other;
  CHECK_FALSE(replies.Read("\xff", &read));
  other.set_protocol_version(limits::kProtocolVersion + 1);
  other.set_request_id(8);
  CHECK_FALSE(replies.Read(other.SerializeAsString(), &read));
  REQUIRE(replies.sent.size() == 2);
  CHECK(CodeOf(replies.sent[0].reply) == StatusCode::kInvalidArgument);
  CHECK(replies.sent[0].reply.request_id() == 0);
  CHECK(CodeOf(replies.sent[1].reply) == StatusCode::kVersionMismatch);
  CHECK(replies.sent[1].reply.request_id() == 8);
  CHECK(replies.requests == 2);
  CHECK(replies.errors == 2);
}

TEST_CASE("A reply that does not fit an envelope is sent as that error") {
  Replies replies;
  pb::Reply small, large;
  small.mutable_open()->set_environment("Hopper");
  large.mutable_open()->set_environment(std::string(limits::kMaxEnvelopeBytes, 'x'));
  replies.responder.Reply({"client", 1}, std::move(small), Frame::Copy("rows"));
  replies.responder.Reply({"client", 2}, std::move(large), Frame::Copy("rows"));
  REQUIRE(replies.sent.size() == 2);
  CHECK(replies.sent[0].reply.open().environment() == "Hopper");
  CHECK(replies.sent[0].reply.protocol_version() == limits::kProtocolVersion);
  CHECK(replies.sent[0].payload == "rows");
  CHECK(CodeOf(replies.sent[1].reply) != StatusCode::kOk);
  CHECK(replies.sent[1].reply.request_id() == 2);
  CHECK(replies.sent[1].payload.empty());
  CHECK(replies.errors == 1);
}

TEST_CASE("An error whose text does not fit an envelope is sent without it") {
  Replies replies;
  replies.responder.Reply(
      {"client", 3}, Status(StatusCode::kUnknownName, std::string(limits::kMaxEnvelopeBytes, 'x')));
  REQUIRE(replies.sent.size() == 1);
  CHECK(CodeOf(replies.sent[0].reply) == StatusCode::kUnknownName);
  CHECK(replies.sent[0].reply.request_id() == 3);
}

}  // namespace
}  // namespace b4mrl
