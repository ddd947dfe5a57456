// The limits on what an environment worker takes: requests under way, and simulators.
//
// Thread rule: the socket's thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <set>

#include "proto/b4mrl.pb.h"
#include "proto/base/status.h"
#include "proto/wire/frame.h"
#include "server/worker/session.h"

namespace b4mrl {

// The requests of all sessions under way.
struct WorkUnderWay {
  size_t requests = 0;
  size_t bytes = 0;  // of their payloads and their replies
  uint32_t renders = 0;
};

// OK if `request` of the session may be examined; all requests and their replies may take `share`
// bytes. Else the error: the request has ended its worker too often, or a limit on requests is
// reached.
Status CheckRequest(const Session& session, const pb::Request& request, const Frame& payload,
                    const WorkUnderWay& all, size_t share);
// kLimitExceeded if a request that would hold `more` bytes with its reply does not fit the share,
// of which `held` are taken.
Status CheckHeldBytes(size_t held, size_t more, size_t share);

// Whether a worker may take `added`, after which it has the simulators `all`, each of them stepped
// by `threads` threads. kLimitExceeded if they could come to take more than `allowed_bytes`;
// kInvalidArgument if `added` could by itself, as no worker will ever have room for it then.
Status CheckSimulators(const Simulator& added, const std::set<const Simulator*>& all,
                       uint32_t threads, uint64_t allowed_bytes);

}  // namespace b4mrl
