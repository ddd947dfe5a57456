#include "algorithms/run/event_file.h"

#include <array>
#include <bit>
#include <chrono>
#include <cstring>
#include <utility>

#include "algorithms/event.pb.h"

namespace b4mrl {
namespace {

constexpr uint32_t kCastagnoli = 0x82f63b78;  // the polynomial, lowest bit first
constexpr uint32_t kMaskDelta = 0xa282ead8;

constexpr std::array<uint32_t, 256> CrcTable() {
  std::array<uint32_t, 256> table{};
  for (uint32_t byte = 0; byte < 256; ++byte) {
    uint32_t crc = byte;
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ (crc % 2 == 1 ? kCastagnoli : 0);
    table[byte] = crc;
  }
  return table;
}

// The number's bytes, little-endian like all processors that this program is built for.
template <typename T>
std::string BytesOf(T value) {
  static_assert(std::endian::native == std::endian::little);
  std::string bytes(sizeof value, '\0');
  std::memcpy(bytes.data(), &value, sizeof value);
  return bytes;
}

double SecondsSinceEpoch() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration<double>(now).count();
}

}  // namespace

uint32_t Crc32c(std::string_view bytes) {
  static constexpr std::array<uint32_t, 256> kTable = CrcTable();
  uint32_t crc = ~0u;
  for (const char c : bytes) crc = (crc >> 8) ^ kTable[(crc ^ static_cast<uint8_t>(c)) & 0xff];
  return ~crc;
}

uint32_t MaskedCrc32c(std::string_view bytes) { return std::rotr(Crc32c(bytes), 15) + kMaskDelta; }

std::string FrameRecord(std::string_view message) {
  const std::string length = BytesOf(static_cast<uint64_t>(message.size()));
  std::string frame = length + BytesOf(MaskedCrc32c(length));
  frame += message;
  return frame + BytesOf(MaskedCrc32c(message));
}

Result<EventFile> EventFile::Open(const std::string& path, uint64_t bytes) {
  B4MRL_ASSIGN_OR_RETURN(AppendedFile file, AppendedFile::Open(path, bytes));
  if (bytes == 0) {
    events::Event event;
    event.set_wall_time(SecondsSinceEpoch());
    event.set_file_version("brain.Event:2");
    B4MRL_RETURN_IF_ERROR(file.Append(FrameRecord(event.SerializeAsString())));
  }
  return EventFile(std::move(file));
}

Status EventFile::Write(int64_t step, const MetricRow& row) {
  events::Event event;
  event.set_wall_time(SecondsSinceEpoch());
  event.set_step(step);
  for (const Metric& metric : row) {
    events::Summary::Value* value = event.mutable_summary()->add_value();
    value->set_tag(metric.name);
    value->set_simple_value(static_cast<float>(metric.value));
  }
  return file_.Append(FrameRecord(event.SerializeAsString()));
}

}  // namespace b4mrl
