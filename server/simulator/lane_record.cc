#include "server/simulator/lane_record.h"

#include <fmt/format.h>

#include <cmath>
#include <cstring>

#include "proto/base/finite.h"

namespace b4mrl {

Status CheckLaneRecord(const LaneLayout& layout, std::span<const std::byte> bytes) {
  if (bytes.size() != layout.bytes()) {
    return InvalidArgument("bytes of a lane's snapshot", std::to_string(bytes.size()),
                           std::to_string(layout.bytes()));
  }
  // Copied byte by byte, because the enumerators may be out of range and the bytes unaligned.
  const auto field = [&bytes](auto value, size_t offset) {
    std::memcpy(&value, bytes.data() + offset, sizeof(value));
    return value;
  };
  const uint32_t phase = field(uint32_t{}, offsetof(LaneHeader, phase));
  if (phase > static_cast<uint32_t>(LanePhase::kEnded)) {
    return InvalidArgument("phase of a lane's snapshot", std::to_string(phase), "0..2");
  }
  for (const size_t offset : {offsetof(LaneHeader, terminated), offsetof(LaneHeader, truncated),
                              offsetof(LaneHeader, episode_ended)}) {
    const uint8_t flag = field(uint8_t{}, offset);
    if (flag > 1) return InvalidArgument("flag of a lane's snapshot", std::to_string(flag), "0, 1");
  }
  const uint8_t cause = field(uint8_t{}, offsetof(LaneHeader, cause));
  if (cause > static_cast<uint8_t>(Cause::kNumericalError)) {
    return InvalidArgument("cause of a lane's snapshot", std::to_string(cause), "0..4");
  }
  for (const size_t offset : {offsetof(LaneHeader, episode_return), offsetof(LaneHeader, reward),
                              offsetof(LaneHeader, final_return)}) {
    const double number = field(double{}, offset);
    if (!std::isfinite(number)) return InvalidNumber("lane's snapshot", number, "finite numbers");
  }
  for (size_t i = 0; i < layout.doubles(); ++i) {
    const double number = field(double{}, sizeof(LaneHeader) + i * sizeof(double));
    const bool is_observed = i >= layout.observation_offset() && i < layout.info_offset();
    if (is_observed ? !FitsFloat32(number) : !std::isfinite(number)) {
      return InvalidNumber(fmt::format("number {} of a lane's snapshot", i), number,
                           is_observed ? "finite as float32" : "finite");
    }
  }
  return Status();
}

}  // namespace b4mrl
