// A request that was read and is not answered yet, and which of two requests are copies.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include "proto/b4mrl.pb.h"
#include "proto/base/clock.h"
#include "proto/base/status.h"
#include "server/replies/reply.h"

namespace b4mrl {

// A hash of all that a request says but for the time that is left for it, which differs between
// copies. Leaves the request as it was.
size_t HashOfContents(pb::Request* request);

// Refuses a request whose id is that of another one under way, of which it is no copy.
Status OtherContents(uint64_t request_id);

struct PendingRequest {
  Asker from;
  pb::Request request;
  Clock::time_point received;
  Deadline deadline = Deadline::AfterMs(0);
  // HashOfContents of `request`, once IsCopy has needed it; `request` stays the same from then on.
  std::optional<size_t> contents = std::nullopt;
};

// Whether a client sent one of the two as a copy of the other: with its id and its contents, but
// for the time that is left for it. Contents are hashed once, whatever a client sends under one id.
bool IsCopy(PendingRequest* one, PendingRequest* other);

}  // namespace b4mrl
