// A lane's snapshot as it travels: 64 bytes that say what it is of, then the lane's record as it
// stands in its slot. Exact, mid-episode, with the names of all random streams; refused by another
// simulator or engine version. Value types; any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

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
// The record inside, copied to `record` (layout.bytes() long, 8-byte aligned) after every check.
// kVersionMismatch if it is another simulator's, engine's or format's; kInvalidArgument if it is
// damaged.
Status ReadSnapshot(uint64_t simulator_hash, const LaneLayout& layout,
                    std::span<const std::byte> snapshot, std::span<std::byte> record);

}  // namespace b4mrl
