// A lane's snapshot as it travels: a header of 64 bytes that names the simulator, then the lane's
// record as it stands in its slot. Snapshots are exact, can be taken within an episode and hold the
// numbers that random draws are addressed by. Another simulator or engine version refuses them.
// Value types; any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "proto/base/status.h"
#include "server/simulator/lane_record.h"

namespace b4mrl {

struct SnapshotHeader {
  uint64_t magic = 0;
  uint32_t version = 0;
  uint32_t record_bytes = 0;
  uint64_t simulator_hash = 0;  // of Simulator::identity(), which names the engine version
  uint64_t checksum = 0;        // of the record
  uint64_t reserved[4] = {};
};
static_assert(sizeof(SnapshotHeader) == 64);

inline size_t SnapshotBytes(const LaneLayout& layout) {
  return sizeof(SnapshotHeader) + layout.bytes();
}
// Writes SnapshotBytes(layout) bytes.
void WriteSnapshot(uint64_t simulator_hash, ConstLaneRecord record, std::span<std::byte> out);
// Checks a snapshot and copies its record to `record` (layout.bytes() long, 8-byte aligned).
// kVersionMismatch if the snapshot is of another simulator, engine or format; kInvalidArgument if
// it is damaged.
Status ReadSnapshot(uint64_t simulator_hash, const LaneLayout& layout,
                    std::span<const std::byte> snapshot, std::span<std::byte> record);

}  // namespace b4mrl
