// What the gateway, the workers and the dataset worker have in common when they answer. Pure
// functions; any thread.
#pragma once

#include <cstdint>

#include "proto/b4mrl.pb.h"
#include "proto/base/clock.h"
#include "proto/base/status.h"
#include "proto/wire/socket.h"

namespace b4mrl {

// The request's own deadline or the default, and `grace_ms` after it, from now.
Deadline DeadlineOf(const pb::Request& request, int64_t grace_ms = 0);

// "protocol version 2 was sent, this server (0.1.0) speaks 1".
Status VersionMismatch(uint32_t version);

// A reply without arrays that carries `status`.
Message ErrorReply(uint64_t request_id, const Status& status);

}  // namespace b4mrl
