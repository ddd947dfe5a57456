#include "tests/integration/support/raw_peer.h"

#include "proto/base/limits.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

constexpr int64_t kPatienceMs = 240'000;
// A server drops replies beyond limits::kHighWaterMark to a peer that does not read them.
constexpr uint64_t kMostUnanswered = limits::kHighWaterMark / 4;

}  // namespace

RawPeer::RawPeer(Context& context, const std::string& address)
    : socket_(Take(DealerSocket::Connect(context, address))) {}

uint64_t RawPeer::Send(pb::Request request, const std::string& token) {
  request.set_protocol_version(limits::kProtocolVersion);
  request.set_request_id(++sent_);
  request.set_session_token(token);
  const std::string bytes = request.SerializeAsString();
  const Deadline deadline = Deadline::AfterMs(kPatienceMs);
  for (Pump(); sent_ - answered_ > kMostUnanswered; Pump()) {
    REQUIRE_FALSE(deadline.expired());
    socket_.Wait(deadline);
  }
  RequireOk(socket_.Send({Frame::Copy(bytes), Frame()}));
  return sent_;
}

void RawPeer::Pump() {
  while (const std::optional<Message> message = socket_.TryReceive()) {
    REQUIRE(ParseEnvelope(message->envelope, &last_).ok());
    ++answered_;
    ++answers_[GetStatus(last_.status()).code()];
  }
}

bool RawPeer::AwaitAll(int64_t patience_ms) {
  const Deadline deadline = Deadline::AfterMs(patience_ms);
  for (Pump(); answered_ < sent_ && !deadline.expired(); Pump()) socket_.Wait(deadline);
  return answered_ == sent_;
}

pb::Reply RawPeer::Call(pb::Request request, const std::string& token, int64_t patience_ms) {
  REQUIRE(AwaitAll(patience_ms));
  const uint64_t id = Send(std::move(request), token);
  REQUIRE(AwaitAll(patience_ms));
  REQUIRE(last_.request_id() == id);
  return last_;
}

std::string AddressOf(const pb::Port& port) {
  if (!port.ipc().empty()) return "ipc://" + port.ipc();
  return "tcp://127.0.0.1:" + std::to_string(port.tcp());
}

}  // namespace b4mrl
