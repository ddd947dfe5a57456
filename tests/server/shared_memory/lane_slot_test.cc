#include "server/shared_memory/lane_slot.h"

#include <catch2/catch.hpp>
#include <cstring>
#include <memory>

#include "server/shared_memory/blame.h"

namespace b4mrl {
namespace {

constexpr size_t kSize = 100;
constexpr uint64_t kGeneration = 7;

// A slot as shared memory gives it: zeros.
std::unique_ptr<LaneSlotMemory> NewMemory() { return std::make_unique<LaneSlotMemory>(); }

void Fill(std::span<std::byte> buffer, int value) { std::memset(buffer.data(), value, kSize); }

LaneSlot NewSlot(LaneSlotMemory* memory) {
  LaneSlot slot(memory);
  Fill(slot.initial_buffer(), 1);
  slot.Initialize(kGeneration, kSize);
  return slot;
}

const uint64_t kStep = AttemptKey(Operation::kStep);

TEST_CASE("A new slot holds record 0 and verifies") {
  const auto memory = NewMemory();
  const LaneSlot slot = NewSlot(memory.get());
  REQUIRE(slot.committed() == 0);
  REQUIRE(slot.committed_operation() == Operation::kNone);
  REQUIRE(slot.committed_record().size() == kSize);
  REQUIRE(slot.committed_record()[50] == std::byte{1});
  REQUIRE(slot.Verify(kGeneration, kSize).ok());
}

TEST_CASE("A commit publishes the idle buffer and leaves the other one whole") {
  const auto memory = NewMemory();
  LaneSlot slot = NewSlot(memory.get());
  for (int number = 1; number <= 5; ++number) {
    Fill(slot.idle_buffer(), number + 1);
    REQUIRE(slot.committed_record()[0] == std::byte(number));
    slot.Commit(Operation::kStep, kSize);
    REQUIRE(slot.committed() == static_cast<uint64_t>(number));
    REQUIRE(slot.committed_record()[0] == std::byte(number + 1));
    REQUIRE(slot.committed_operation() == Operation::kStep);
    REQUIRE(slot.Verify(kGeneration, kSize).ok());
  }
}

TEST_CASE("Whatever a dying writer leaves in the idle buffer, the committed record verifies") {
  const auto memory = NewMemory();
  LaneSlot slot = NewSlot(memory.get());
  Fill(slot.idle_buffer(), 2);
  slot.Commit(Operation::kReset, kSize);
  const std::span<std::byte> idle = slot.idle_buffer();
  std::memset(idle.data(), 0xa5, idle.size());
  REQUIRE(slot.Verify(kGeneration, kSize).ok());
  REQUIRE(slot.committed_record()[99] == std::byte{2});
}

TEST_CASE("A damaged record is told from a whole one") {
  const auto memory = NewMemory();
  LaneSlot slot = NewSlot(memory.get());
  REQUIRE(slot.Verify(kGeneration + 1, kSize).code() == StatusCode::kDataLoss);
  REQUIRE(slot.Verify(kGeneration, kSize + 1).code() == StatusCode::kDataLoss);
  SECTION("every single bit of the record counts") {
    for (size_t bit = 0; bit < 8 * kSize; ++bit) {
      memory->first[bit / 8] ^= std::byte(1 << (bit % 8));
      REQUIRE(slot.Verify(kGeneration, kSize).code() == StatusCode::kDataLoss);
      memory->first[bit / 8] ^= std::byte(1 << (bit % 8));
    }
    REQUIRE(slot.Verify(kGeneration, kSize).ok());
  }
  SECTION("a number without its record") {
    memory->committed.store(1);
    REQUIRE(slot.Verify(kGeneration, kSize).code() == StatusCode::kDataLoss);
  }
  SECTION("a record that passes for a later one in the same buffer") {
    memory->seals[0].number = 2;
    memory->committed.store(2);
    REQUIRE(slot.Verify(kGeneration, kSize).code() == StatusCode::kDataLoss);
  }
  SECTION("a size beyond the buffer") {
    memory->seals[0].size = UINT32_MAX;
    REQUIRE(slot.Verify(kGeneration, UINT32_MAX).code() == StatusCode::kDataLoss);
  }
}

TEST_CASE("Two crashes have an operation refused, and the next one is innocent") {
  const auto memory = NewMemory();
  LaneSlot slot = NewSlot(memory.get());
  slot.AddBlame(1, kStep, kCrashBlame);
  REQUIRE_FALSE(OperationIsRefused(slot, kStep));
  slot.AddBlame(1, kStep, kCrashBlame);
  REQUIRE(OperationIsRefused(slot, kStep));
  Fill(slot.idle_buffer(), 2);
  slot.Commit(Operation::kStep, kSize);
  REQUIRE_FALSE(OperationIsRefused(slot, kStep));
  slot.AddBlame(2, kStep, kCrashBlame);
  REQUIRE_FALSE(OperationIsRefused(slot, kStep));
}

TEST_CASE(
    "A refused operation may be done in another way; after two more its replacement is refused") {
  const auto memory = NewMemory();
  LaneSlot slot = NewSlot(memory.get());
  const uint64_t reset = AttemptKey(Operation::kReset, 7);
  for (int crash = 0; crash < 2; ++crash) slot.AddBlame(1, reset, kCrashBlame);
  REQUIRE(OperationIsRefused(slot, reset));
  REQUIRE_FALSE(OperationIsRefused(slot, AttemptKey(Operation::kReset, 8)));
  REQUIRE_FALSE(OperationIsRefused(slot, AttemptKey(Operation::kReset)));
  REQUIRE_FALSE(OperationIsRefused(slot, AttemptKey(Operation::kRestore)));
  REQUIRE_FALSE(TruncationIsRefused(slot, reset));
  for (int crash = 0; crash < 2; ++crash) slot.AddBlame(1, reset, kCrashBlame);
  REQUIRE(TruncationIsRefused(slot, reset));
}

TEST_CASE(
    "Kills from outside have nothing refused until they are many, and committed operations are not "
    "blamed") {
  const auto memory = NewMemory();
  LaneSlot slot = NewSlot(memory.get());
  for (uint32_t kills = 0; kills < 7; ++kills) slot.AddBlame(1, kStep, kKillBlame);
  REQUIRE_FALSE(OperationIsRefused(slot, kStep));
  slot.AddBlame(0, kStep, kCrashBlame);
  slot.AddBlame(2, kStep, kCrashBlame);
  REQUIRE_FALSE(OperationIsRefused(slot, kStep));
  slot.AddBlame(1, kStep, kKillBlame);
  REQUIRE(OperationIsRefused(slot, kStep));
}

}  // namespace
}  // namespace b4mrl
