// A lane's place in shared memory: its last committed record and room for the next one.
//
// Operation N (a step, reset or restore) is computed straight into buffer N & 1, sealed with its
// size and a checksum, and published by one release store of N. A process killed anywhere leaves
// the last committed record whole, so that a replacement has nothing to recover. The process that
// wrote a record reads it without a check; a replacement calls Verify first, because a dying
// process may have written anywhere.
//
// Thread rule: at most one thread works on a lane, as a lane has at most one request in flight. The
// supervisor touches nothing but the blame, and only while no worker has the lane. A LaneSlot is a
// view of memory that it does not own.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "proto/base/limits.h"
#include "proto/base/status.h"

namespace b4mrl {

enum class Operation : uint32_t { kNone = 0, kStep = 1, kReset = 2, kRestore = 3 };
std::string_view OperationName(Operation operation);

struct BufferSeal {
  uint64_t number = 0;
  uint64_t checksum = 0;
  uint32_t size = 0;
  Operation operation = Operation::kNone;
};

struct alignas(64) LaneSlotMemory {
  std::atomic<uint64_t> committed;
  std::atomic<uint64_t> generation;      // of the session that owns the lane
  std::atomic<uint64_t> blamed_number;   // the operation that `blame` is about
  std::atomic<uint64_t> blamed_attempt;  // AttemptKey of that operation
  std::atomic<uint32_t> blame;           // points of blame
  std::array<BufferSeal, 2> seals;
  // The second buffer starts a little off a power of two, and so does the next slot, so that equal
  // offsets of many lanes fall into different cache sets.
  alignas(64) std::array<std::byte, limits::kLaneBufferBytes> first;
  alignas(64) std::array<std::byte, 9 * 64> gap;
  alignas(64) std::array<std::byte, limits::kLaneBufferBytes> second;
};

class LaneSlot {
 public:
  explicit LaneSlot(LaneSlotMemory* memory) : memory_(memory) {}

  uint64_t committed() const { return memory_->committed.load(std::memory_order_acquire); }
  Operation committed_operation() const { return seal(committed()).operation; }
  std::span<const std::byte> committed_record() const;
  // Where operation committed() + 1 writes its record; limits::kLaneBufferBytes long.
  std::span<std::byte> idle_buffer() { return buffer(committed() + 1); }
  // Publishes the idle buffer's first `size` bytes as operation committed() + 1. Seal and Publish
  // are the halves of Commit: Seal completes the buffer, Publish makes it count.
  void Commit(Operation operation, size_t size);
  void Seal(Operation operation, size_t size) { WriteSeal(committed() + 1, operation, size); }
  void Publish() { memory_->committed.store(committed() + 1, std::memory_order_release); }

  // Makes the slot a new session's: the first buffer's `size` bytes, written by the caller
  // beforehand, are its record number 0. Only for a lane whose session is not live yet.
  void Initialize(uint64_t generation, size_t size);
  std::span<std::byte> initial_buffer() { return buffer(0); }

  // kDataLoss unless the committed record is whole, `size` bytes long and of session `generation`.
  Status Verify(uint64_t generation, size_t size) const;

  // Points of blame (server/shared_memory/blame.h), which the supervisor adds to operation `number`
  // when a process died at it. Points for another operation than committed() + 1 are dropped.
  void AddBlame(uint64_t number, uint64_t attempt, uint32_t points);
  // The points of operation committed() + 1 in this attempt.
  uint32_t Blame(uint64_t attempt) const;

 private:
  const BufferSeal& seal(uint64_t number) const { return memory_->seals[number & 1]; }
  std::span<std::byte> buffer(uint64_t number) const {
    return (number & 1) == 0 ? std::span<std::byte>(memory_->first)
                             : std::span<std::byte>(memory_->second);
  }
  uint64_t Checksum(const BufferSeal& seal) const;
  void WriteSeal(uint64_t number, Operation operation, size_t size);

  LaneSlotMemory* memory_;
};

}  // namespace b4mrl
