#include "server/replies/reply.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "proto/base/limits.h"
#include "proto/base/version.h"

namespace b4mrl {

Deadline DeadlineOf(const pb::Request& request, int64_t grace_ms) {
  const int64_t deadline_ms =
      request.deadline_ms() == 0 ? limits::kDefaultDeadlineMs : request.deadline_ms();
  return Deadline::AfterMs(std::min(deadline_ms, limits::kMaxDeadlineMs) + grace_ms);
}

Status Stopping() { return Status(StatusCode::kUnavailable, "the daemon is stopping"); }

Status CheckWaiting(std::string_view things, const WaitingCount& now, const WaitingCount& most) {
  if (now.of_all < most.of_all && now.of_peer < most.of_peer) return Status();
  return Status(StatusCode::kLimitExceeded,
                fmt::format("{} {} wait already, {} of this connection; allowed: {}, {} of one "
                            "connection",
                            now.of_all, things, now.of_peer, most.of_all, most.of_peer));
}

std::optional<Asker> Responder::Read(const IncomingMessage& incoming, pb::Request* request) {
  counters_.requests.fetch_add(1, std::memory_order_relaxed);
  request->Clear();
  if (const Status status = ParseEnvelope(incoming.message.envelope, request); !status.ok()) {
    ReplyError({incoming.sender, 0}, status);
    return std::nullopt;
  }
  Asker from{incoming.sender, request->request_id()};
  const uint32_t version = request->protocol_version();
  if (version == limits::kProtocolVersion) return from;
  ReplyError(from, Status(StatusCode::kVersionMismatch,
                          fmt::format("protocol version {} was sent, this server ({}) speaks {}",
                                      version, ProjectVersion(), limits::kProtocolVersion)));
  return std::nullopt;
}

void Responder::Reply(const Asker& to, Result<pb::Reply> reply, Frame payload) {
  if (!reply.ok()) return ReplyError(to, reply.status());
  reply->set_protocol_version(limits::kProtocolVersion);
  reply->set_request_id(to.request_id);
  reply->mutable_status();
  Result<Frame> envelope = SerializeEnvelope(*reply);
  if (!envelope.ok()) return ReplyError(to, envelope.status());
  send_(to.peer, {std::move(*envelope), std::move(payload)});
}

void Responder::ReplyError(const Asker& to, const Status& error) {
  counters_.errors.fetch_add(1, std::memory_order_relaxed);
  pb::Reply reply;
  reply.set_protocol_version(limits::kProtocolVersion);
  reply.set_request_id(to.request_id);
  SetStatus(error, reply.mutable_status());
  // An error quotes at most a few names of its request, which itself fits an envelope.
  Result<Frame> envelope = SerializeEnvelope(reply);
  if (!envelope.ok()) {
    reply.mutable_status()->set_message("the error message is too long for an envelope");
    envelope = SerializeEnvelope(reply);
  }
  send_(to.peer, {envelope.ok() ? std::move(*envelope) : Frame(), Frame()});
}

}  // namespace b4mrl
