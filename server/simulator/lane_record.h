// A lane as plain memory: everything about one environment of a session in one block without
// pointers, which can be copied by memcpy, kept in shared memory and sent (a Snapshot is its
// bytes).
//
//   LaneHeader | state | perturbation state | observation | final observation | infos | final infos
//
// The last step's outcome is part of the record, so a process that has a committed record can
// answer the step again without simulating. Records of one LaneLayout are interchangeable; the
// block is 8-byte aligned and at most limits::kLaneBufferBytes long. Views own no memory; threads
// share a record as they share any memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "proto/base/status.h"
#include "server/environments/environment.h"

namespace b4mrl {

enum class LanePhase : uint32_t {
  kFresh = 0,  // never reset: cannot be stepped
  kRunning = 1,
  kEnded = 2,  // the episode is over; the auto-reset mode says what a step does
};

struct LaneHeader {
  uint64_t lane_seed = 0;
  uint64_t episode = 0;        // counts from 0; with lane_seed it names every random stream
  uint64_t elapsed_steps = 0;  // of this episode
  double episode_return = 0;   // undiscounted, of this episode
  // A rolling hash of observations, actions, rewards and flags since the seed was set.
  uint64_t digest = 0;
  LanePhase phase = LanePhase::kFresh;

  // The last operation's outcome. The observation stands behind the header.
  uint8_t terminated = 0;
  uint8_t truncated = 0;
  Cause cause = Cause::kNone;
  // 1 after a termination or truncation: the final observation, infos, return and length are valid.
  uint8_t episode_ended = 0;
  double reward = 0;
  double final_return = 0;
  uint64_t final_length = 0;
};
static_assert(sizeof(LaneHeader) == 72);

struct LaneLayout {
  size_t state_size = 0;
  size_t perturbation_state_size = 0;
  size_t observation_size = 0;
  size_t info_size = 0;

  size_t doubles() const {
    return state_size + perturbation_state_size + 2 * observation_size + 2 * info_size;
  }
  size_t bytes() const { return sizeof(LaneHeader) + doubles() * sizeof(double); }
  // Doubles before the observation, behind which the final one stands, and before the infos.
  size_t observation_offset() const { return state_size + perturbation_state_size; }
  size_t info_offset() const { return observation_offset() + 2 * observation_size; }
  bool operator==(const LaneLayout&) const = default;
};

// A view of a lane's memory; Byte is std::byte or const std::byte.
template <typename Byte>
class BasicLaneRecord {
  template <typename T>
  using Like = std::conditional_t<std::is_const_v<Byte>, const T, T>;

 public:
  // `memory`: at least layout.bytes() bytes, 8-byte aligned.
  BasicLaneRecord(const LaneLayout& layout, Byte* memory) : layout_(layout), memory_(memory) {}

  Like<LaneHeader>& header() const { return *reinterpret_cast<Like<LaneHeader>*>(memory_); }
  std::span<Like<double>> state() const { return Part(0, layout_.state_size); }
  std::span<Like<double>> perturbation_state() const {
    return Part(layout_.state_size, layout_.perturbation_state_size);
  }
  // The observation that the client sees after the last operation.
  std::span<Like<double>> observation() const {
    return Part(layout_.observation_offset(), layout_.observation_size);
  }
  // The last observation of the episode that ended, if header().episode_ended.
  std::span<Like<double>> final_observation() const {
    return Part(layout_.observation_offset() + layout_.observation_size, layout_.observation_size);
  }
  // infos: Environment::Infos after the last operation. final_infos: those at an episode's end.
  std::span<Like<double>> infos() const { return Part(layout_.info_offset(), layout_.info_size); }
  std::span<Like<double>> final_infos() const {
    return Part(layout_.info_offset() + layout_.info_size, layout_.info_size);
  }
  std::span<Byte> bytes() const { return {memory_, layout_.bytes()}; }
  const LaneLayout& layout() const { return layout_; }

 private:
  std::span<Like<double>> Part(size_t offset, size_t size) const {
    auto* doubles = reinterpret_cast<Like<double>*>(memory_ + sizeof(LaneHeader));
    return {doubles + offset, size};
  }

  LaneLayout layout_;
  Byte* memory_;
};
using LaneRecord = BasicLaneRecord<std::byte>;
using ConstLaneRecord = BasicLaneRecord<const std::byte>;

// OK if a client's bytes may become a lane: right length, known enumerators, every number finite,
// those of observations also as float32.
Status CheckLaneRecord(const LaneLayout& layout, std::span<const std::byte> bytes);

}  // namespace b4mrl
