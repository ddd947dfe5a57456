#include "server/worker/admission.h"

#include <fmt/format.h>

#include <string>

#include "proto/base/limits.h"
#include "server/process/memory_shares.h"
#include "server/shared_memory/blame.h"
#include "server/worker/request_job.h"

namespace b4mrl {
namespace {

// Rounded up, so that what is above the allowed bytes also reads so.
uint64_t Mib(uint64_t bytes) { return (bytes + (1 << 20) - 1) >> 20; }

}  // namespace

Status CheckRequest(const Session& session, const pb::Request& request, const Frame& payload,
                    const WorkUnderWay& all, size_t share) {
  if (RequestIsRefused(session.record(), request.request_id())) {
    return Status(StatusCode::kInternal,
                  "this request ended its worker again and again, and is not repeated");
  }
  const size_t in_flight = session.requests_in_flight();
  if (in_flight >= limits::kMaxRequestsInFlight) {
    return Status(StatusCode::kLimitExceeded,
                  fmt::format("the session has {} requests in flight, at most {}", in_flight,
                              limits::kMaxRequestsInFlight));
  }
  size_t bytes = payload.size(), renders = 0;
  for (const auto& [id, job] : session.in_flight()) {
    bytes += job->payload().size();
    if (job->waits_for_painter()) ++renders;
  }
  if (bytes > limits::kMaxSessionBytes ||
      (request.has_render() && renders >= limits::kMaxSessionRenders)) {
    return Status(StatusCode::kLimitExceeded,
                  fmt::format("the session would have {} bytes and {} requests for pictures in "
                              "flight, at most {} and {}",
                              bytes, renders + (request.has_render() ? 1 : 0),
                              limits::kMaxSessionBytes, limits::kMaxSessionRenders));
  }
  if (all.requests >= limits::kMaxQueuedRequests) {
    return Status(StatusCode::kLimitExceeded,
                  fmt::format("the worker has {} requests waiting, at most {}", all.requests,
                              limits::kMaxQueuedRequests));
  }
  B4MRL_RETURN_IF_ERROR(CheckHeldBytes(all.bytes, payload.size(), share));
  if (request.has_render() && all.renders >= limits::kMaxRenderRequests) {
    return Status(StatusCode::kLimitExceeded,
                  fmt::format("the worker has {} requests for pictures waiting, at most {}",
                              all.renders, limits::kMaxRenderRequests));
  }
  return Status();
}

Status CheckHeldBytes(size_t held, size_t more, size_t share) {
  if (FitsShare(held, more, share)) return Status();
  return Status(StatusCode::kLimitExceeded,
                fmt::format("the worker's requests under way and their replies would have {} "
                            "bytes, at most {} (by `b4mrl serve --memory`)",
                            held + more, share));
}

Status CheckSimulators(const Simulator& added, const std::set<const Simulator*>& all,
                       uint32_t threads, uint64_t allowed_bytes) {
  const std::string allowed = fmt::format(
      "allowed: {} (by `b4mrl serve --memory` and the machine's memory)", allowed_bytes >> 20);
  if (const uint64_t alone = added.memory_bytes(threads); alone > allowed_bytes) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("the session's simulator could take {} MiB of memory in the worker's "
                              "{} threads, {}",
                              Mib(alone), threads, allowed));
  }
  uint64_t bytes = 0;
  for (const Simulator* one : all) bytes += one->memory_bytes(threads);
  if (bytes <= allowed_bytes) return Status();
  return Status(StatusCode::kLimitExceeded,
                fmt::format("the worker's {} different simulators could take {} MiB of memory, {}",
                            all.size(), Mib(bytes), allowed));
}

}  // namespace b4mrl
