// What the server is, its environments and the sessions' descriptions as protocol messages.
#pragma once

#include "proto/b4mrl.pb.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"
#include "server/worker/session.h"

namespace b4mrl {

// Versions, capabilities and limits: a Hello but for the ports.
void DescribeServer(int64_t lease_ms, pb::HelloReply* out);
void DescribeEnvironment(const EnvironmentSpec& spec, pb::EnvironmentInfo* out);
// Everything in force.
void DescribeSession(const Session& session, pb::AttachReply* out);
// An OpenReply but for the port, from the completed request and what the worker said.
void DescribeOpen(const pb::OpenRequest& request, const pb::AttachReply& session,
                  pb::OpenReply* out);

// "protocol version 2, this server speaks 1 (0.1.0)".
Status VersionMismatch(uint32_t version);
// Of this project: "0.1.0".
std::string_view ServerVersion();

}  // namespace b4mrl
