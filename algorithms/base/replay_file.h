// The layout of replay.bin, the file of a learner's experience (experience/replay_buffer.h): a
// header, filled up with zeros to kReplayHeaderBytes, then a record of float32 for each transition:
// observation, action, next observation, reward, and 1 or, after a terminal transition, 0. Space
// that was reserved for further ones follows; the run's checkpoints say how many records count.
#pragma once

#include <array>
#include <cstdint>

namespace b4mrl {

inline constexpr std::array<char, 8> kReplayMagic = {'B', '4', 'R', 'E', 'P', 'L', 'A', '1'};
inline constexpr uint64_t kReplayHeaderBytes = 64;  // keeps records aligned for SIMD loads

struct ReplayHeader {
  std::array<char, 8> magic = kReplayMagic;
  uint32_t observation_size = 0;
  uint32_t action_size = 0;
};

}  // namespace b4mrl
