// The worker's description of a session, which the gateway passes on in the reply to Open. Any
// thread.
#pragma once

#include "proto/b4mrl.pb.h"
#include "server/worker/session.h"

namespace b4mrl {

// Fills in what is in force: spaces, completed configuration, resolved perturbations, experiment
// id.
void DescribeSession(const Session& session, pb::AttachReply* out);

}  // namespace b4mrl
