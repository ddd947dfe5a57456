#include "server/shared_memory/lane_slot.h"

#include <fmt/format.h>
#include <xxhash.h>

namespace b4mrl {

std::string_view OperationName(Operation operation) {
  switch (operation) {
    case Operation::kNone:
      return "nothing";
    case Operation::kStep:
      return "a step";
    case Operation::kReset:
      return "a reset";
    case Operation::kRestore:
      return "a restore";
  }
  return "unknown";
}

std::span<const std::byte> LaneSlot::committed_record() const {
  const uint64_t number = committed();
  return buffer(number).first(seal(number).size);
}

uint64_t LaneSlot::Checksum(const BufferSeal& seal) const {
  // The seal's fields are the hash's seed, so that no record passes for that of another number.
  const uint64_t seed = seal.number * 0x9e3779b97f4a7c15ull + static_cast<uint64_t>(seal.operation);
  return XXH3_64bits_withSeed(buffer(seal.number).data(), seal.size, seed);
}

void LaneSlot::WriteSeal(uint64_t number, Operation operation, size_t size) {
  BufferSeal& target = memory_->seals[number & 1];
  target.number = number;
  target.size = static_cast<uint32_t>(size);
  target.operation = operation;
  target.checksum = Checksum(target);
}

void LaneSlot::Commit(Operation operation, size_t size) {
  Seal(operation, size);
  Publish();
}

void LaneSlot::Initialize(uint64_t generation, size_t size) {
  WriteSeal(0, Operation::kNone, size);
  memory_->blame.store(0, std::memory_order_relaxed);
  memory_->blamed_number.store(0, std::memory_order_relaxed);
  memory_->blamed_attempt.store(0, std::memory_order_relaxed);
  memory_->generation.store(generation, std::memory_order_relaxed);
  memory_->committed.store(0, std::memory_order_release);
}

Status LaneSlot::Verify(uint64_t generation, size_t size) const {
  const uint64_t number = committed();
  const BufferSeal copy = seal(number);
  if (memory_->generation.load(std::memory_order_relaxed) != generation) {
    return Status(StatusCode::kDataLoss, "the slot belongs to another session");
  }
  if (copy.number != number || copy.size != size || copy.size > limits::kLaneBufferBytes) {
    return Status(StatusCode::kDataLoss,
                  fmt::format("record {} of {} bytes where number {} of {} bytes was committed",
                              copy.number, copy.size, number, size));
  }
  if (Checksum(copy) != copy.checksum) {
    return Status(StatusCode::kDataLoss, fmt::format("record {} has a wrong checksum", number));
  }
  return Status();
}

void LaneSlot::AddBlame(uint64_t number, uint64_t attempt, uint32_t points) {
  if (number != committed() + 1) return;
  if (memory_->blamed_number.load(std::memory_order_relaxed) != number ||
      memory_->blamed_attempt.load(std::memory_order_relaxed) != attempt) {
    memory_->blamed_number.store(number, std::memory_order_relaxed);
    memory_->blamed_attempt.store(attempt, std::memory_order_relaxed);
    memory_->blame.store(0, std::memory_order_relaxed);
  }
  memory_->blame.fetch_add(points, std::memory_order_relaxed);
}

uint32_t LaneSlot::Blame(uint64_t attempt) const {
  const uint32_t blame = memory_->blame.load(std::memory_order_relaxed);
  if (blame == 0) return 0;  // as nearly always
  const bool is_meant = memory_->blamed_number.load(std::memory_order_relaxed) == committed() + 1 &&
                        memory_->blamed_attempt.load(std::memory_order_relaxed) == attempt;
  return is_meant ? blame : 0;
}

}  // namespace b4mrl
