#include "server/worker/snapshot_blob.h"

#include <xxhash.h>

#include <cstring>

namespace b4mrl {
namespace {

constexpr uint64_t kMagic = 0x4c4e44342d62346d;
constexpr uint32_t kVersion = 2;

}  // namespace

void WriteSnapshot(uint64_t simulator_hash, ConstLaneRecord record, std::span<std::byte> out) {
  SnapshotHeader header;
  header.magic = kMagic;
  header.version = kVersion;
  header.record_bytes = static_cast<uint32_t>(record.layout().bytes());
  header.simulator_hash = simulator_hash;
  header.checksum = XXH3_64bits(record.bytes().data(), record.bytes().size());
  std::memcpy(out.data(), &header, sizeof(header));
  std::memcpy(out.data() + sizeof(header), record.bytes().data(), record.bytes().size());
}

Status ReadSnapshot(uint64_t simulator_hash, const LaneLayout& layout,
                    std::span<const std::byte> snapshot, std::span<std::byte> record) {
  if (snapshot.size() != SnapshotBytes(layout)) {
    return InvalidNumber("bytes of snapshot", static_cast<double>(snapshot.size()),
                         std::to_string(SnapshotBytes(layout)));
  }
  SnapshotHeader header;
  std::memcpy(&header, snapshot.data(), sizeof(header));
  const std::span<const std::byte> body = snapshot.subspan(sizeof(header));
  if (header.magic != kMagic || header.record_bytes != body.size()) {
    return InvalidArgument("snapshot", "other bytes", "what Snapshot returned, unchanged");
  }
  if (header.version != kVersion || header.simulator_hash != simulator_hash) {
    return Status(StatusCode::kVersionMismatch,
                  "the snapshot is of another simulator, configuration or engine version");
  }
  if (header.checksum != XXH3_64bits(body.data(), body.size())) {
    return InvalidArgument("snapshot", "damaged", "what Snapshot returned, unchanged");
  }
  std::memcpy(record.data(), body.data(), body.size());
  return CheckLaneRecord(layout, record);
}

}  // namespace b4mrl
