// What the server is, and what it has opened, as protocol messages. Pure functions; any thread.
#pragma once

#include "proto/b4mrl.pb.h"

namespace b4mrl {

// Versions, capabilities and limits: a Hello but for the ports.
void DescribeServer(int64_t lease_ms, pb::HelloReply* out);
// An OpenReply but for the port, from the completed request and what the worker said.
void DescribeOpen(const pb::OpenRequest& request, const pb::AttachReply& session,
                  pb::OpenReply* out);

}  // namespace b4mrl
