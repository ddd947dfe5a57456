// The Open that a session's record holds. Any thread.
#pragma once

#include "proto/b4mrl.pb.h"
#include "proto/base/status.h"
#include "server/shared_memory/shared_state.h"

namespace b4mrl {

// What the client asked for, completed by the gateway (server/gateway/open_request.h). kDataLoss if
// the record is damaged.
Result<pb::OpenRequest> OpenRequestOf(const SessionRecord& record);

}  // namespace b4mrl
