// The replies to Hello and Open. Pure functions; any thread.
#pragma once

#include "proto/b4mrl.pb.h"

namespace b4mrl {

// Fills in versions, capabilities and limits: all of a HelloReply but the dataset worker's port.
// `has_doors`: clients of this machine can share memory with the workers.
void DescribeServer(int64_t lease_ms, bool has_doors, pb::HelloReply* out);
// Fills in all of an OpenReply but the worker's port, from the completed request and the worker's
// reply to Attach.
void DescribeOpen(const pb::OpenRequest& request, const pb::AttachReply& session,
                  pb::OpenReply* out);

}  // namespace b4mrl
