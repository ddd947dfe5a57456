#include "server/replies/reply.h"

#include <fmt/format.h>

#include <algorithm>

#include "proto/base/limits.h"
#include "proto/base/version.h"

namespace b4mrl {

Deadline DeadlineOf(const pb::Request& request, int64_t grace_ms) {
  const int64_t deadline_ms =
      request.deadline_ms() == 0 ? limits::kDefaultDeadlineMs : request.deadline_ms();
  return Deadline::AfterMs(std::min(deadline_ms, limits::kMaxDeadlineMs) + grace_ms);
}

Status VersionMismatch(uint32_t version) {
  return Status(StatusCode::kVersionMismatch,
                fmt::format("protocol version {} was sent, this server ({}) speaks {}", version,
                            ProjectVersion(), limits::kProtocolVersion));
}

Message ErrorReply(uint64_t request_id, const Status& status) {
  pb::Reply reply;
  reply.set_protocol_version(limits::kProtocolVersion);
  reply.set_request_id(request_id);
  SetStatus(status, reply.mutable_status());
  // An error text quotes at most a few names of the request, which itself fits an envelope.
  Result<Frame> envelope = SerializeEnvelope(reply);
  if (envelope.ok()) return {std::move(*envelope), Frame()};
  reply.mutable_status()->set_message("the error message is too long for an envelope");
  envelope = SerializeEnvelope(reply);
  return {envelope.ok() ? std::move(*envelope) : Frame(), Frame()};
}

}  // namespace b4mrl
