#include "server/process/memory_shares.h"

#include <algorithm>

#include "proto/base/limits.h"

namespace b4mrl {
namespace {

// Of all Renders that may wait in a worker, each of the largest.
constexpr size_t kMaxPictureBytesOfAll = limits::kMaxRenderRequests * limits::kMaxPayloadBytes;

size_t AtMost(size_t most, uint64_t share) {
  return static_cast<size_t>(std::min<uint64_t>(most, share));
}

UnreadLimits UnreadOf(uint64_t share) {
  return {.of_one = AtMost(limits::kMaxUnreadBytes, share / 2),
          .of_all = AtMost(limits::kMaxUnreadBytesOfAll, share)};
}

}  // namespace

WorkerShares WorkerSharesOf(uint64_t allowed_bytes) {
  return {.simulators = allowed_bytes / 16 * 11,
          .unread = UnreadOf(allowed_bytes / 8),
          .requests = AtMost(limits::kMaxQueuedBytes, allowed_bytes / 16),
          .unfinished = AtMost(limits::kMaxQueuedBytes, allowed_bytes / 16),
          .pictures = AtMost(kMaxPictureBytesOfAll, allowed_bytes / 16)};
}

GatewayShares GatewaySharesOf(uint64_t allowed_bytes) {
  return {.unread = UnreadOf(allowed_bytes / 2),
          .relayed = AtMost(limits::kMaxRelayBytes, allowed_bytes / 4)};
}

DatasetWorkerShares DatasetWorkerSharesOf(uint64_t allowed_bytes) {
  return {.unread = UnreadOf(allowed_bytes / 2),
          .filled = AtMost(limits::kMaxFilledBytes, allowed_bytes / 8)};
}

}  // namespace b4mrl
