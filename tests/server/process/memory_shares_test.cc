#include "server/process/memory_shares.h"

#include <catch2/catch.hpp>

#include "proto/base/limits.h"

namespace b4mrl {
namespace {

constexpr uint64_t kMib = 1 << 20;

TEST_CASE("The shares of a process are no more than the memory that it is allowed") {
  for (const uint64_t mib : {limits::kMinMemoryMib, 1000u, 16'000u, limits::kMaxMemoryMib}) {
    const WorkerShares worker = WorkerSharesOf(mib * kMib);
    CHECK(worker.simulators + worker.unread.of_all + worker.requests + worker.unfinished +
              worker.pictures <=
          mib * kMib);
    const GatewayShares gateway = GatewaySharesOf(mib * kMib);
    CHECK(gateway.unread.of_all + gateway.relayed < mib * kMib);
    const DatasetWorkerShares datasets = DatasetWorkerSharesOf(mib * kMib);
    CHECK(datasets.unread.of_all + 2 * datasets.filled < mib * kMib);
  }
}

TEST_CASE("Much memory raises no limit") {
  const WorkerShares worker = WorkerSharesOf(kMib * kMib);
  CHECK(worker.requests == limits::kMaxQueuedBytes);
  CHECK(worker.unfinished == limits::kMaxQueuedBytes);
  CHECK(worker.pictures == limits::kMaxRenderRequests * limits::kMaxPayloadBytes);
  const GatewayShares gateway = GatewaySharesOf(kMib * kMib);
  CHECK(gateway.relayed == limits::kMaxRelayBytes);
  const DatasetWorkerShares datasets = DatasetWorkerSharesOf(kMib * kMib);
  CHECK(datasets.filled == limits::kMaxFilledBytes);
  for (const UnreadLimits& unread : {worker.unread, gateway.unread, datasets.unread}) {
    CHECK(unread.of_one == limits::kMaxUnreadBytes);
    CHECK(unread.of_all == limits::kMaxUnreadBytesOfAll);
  }
}

TEST_CASE("Little memory lowers all limits") {
  const WorkerShares worker = WorkerSharesOf(64 * kMib);
  CHECK(worker.simulators == 44 * kMib);
  CHECK(worker.unread.of_one == 4 * kMib);
  CHECK(worker.unread.of_all == 8 * kMib);
  CHECK(worker.requests == 4 * kMib);
  CHECK(worker.unfinished == 4 * kMib);
  CHECK(worker.pictures == 4 * kMib);
  CHECK(GatewaySharesOf(64 * kMib).relayed == 16 * kMib);
  CHECK(GatewaySharesOf(64 * kMib).unread.of_all == 32 * kMib);
  const DatasetWorkerShares datasets = DatasetWorkerSharesOf(64 * kMib);
  CHECK(datasets.unread.of_one == 16 * kMib);
  CHECK(datasets.filled == 8 * kMib);
}

}  // namespace
}  // namespace b4mrl
