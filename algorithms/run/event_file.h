// The event file that TensorBoard reads: one framed protocol buffer after another, each with the
// values of one row.
//
// A frame is the message's length (8 bytes, little-endian), its masked CRC-32C, the message and its
// masked CRC-32C. A frame's size follows from its names and its step alone, so a resumed run, which
// writes the same rows again, puts them at the same offsets: a TensorBoard that reads along while
// the run is resumed goes on where it was. Thread rule: one thread. Errors: run/appended_file.h.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "algorithms/base/metrics.h"
#include "algorithms/run/appended_file.h"
#include "proto/base/status.h"

namespace b4mrl {

// CRC-32C (Castagnoli) of `bytes`, and the masked form of that checksum which event files store.
uint32_t Crc32c(std::string_view bytes);
uint32_t MaskedCrc32c(std::string_view bytes);
// The frame of one message: length, checksums and `message`.
std::string FrameRecord(std::string_view message);

class EventFile {
 public:
  // Opens the file cut to its first `bytes` bytes; 0: a new file.
  static Result<EventFile> Open(const std::string& path, uint64_t bytes);

  // Appends the values of one row. The names in `row` are tags: "losses/critic_loss".
  Status Write(int64_t step, const MetricRow& row);
  Status Sync() { return file_.Sync(); }
  uint64_t bytes() const { return file_.bytes(); }

 private:
  explicit EventFile(AppendedFile file) : file_(std::move(file)) {}

  AppendedFile file_;
};

}  // namespace b4mrl
