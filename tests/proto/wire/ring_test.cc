#include "proto/wire/ring.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cstring>
#include <numeric>
#include <vector>

#include "proto/base/limits.h"

namespace b4mrl {
namespace {

constexpr size_t kSize = 1024;  // small, so that messages wrap and exceed it
constexpr size_t kAnyPayload = limits::kMaxPayloadBytes;

// A ring in this process's own memory, with both ends.
struct Fixture {
  std::atomic<uint64_t> head{0}, tail{0};
  std::vector<std::byte> bytes = std::vector<std::byte>(kSize);
  Ring ring{&head, &tail, bytes.data(), kSize};
  RingWriter writer{ring};
  RingReader reader{ring};
};

Frame FrameOf(size_t size, uint8_t first) {
  Frame frame = Frame::OfSize(size);
  auto* const bytes = reinterpret_cast<uint8_t*>(frame.data());
  std::iota(bytes, bytes + size, first);
  return frame;
}

Message MessageOf(size_t envelope, size_t payload, uint8_t first = 1) {
  return {FrameOf(envelope, first), FrameOf(payload, static_cast<uint8_t>(first + 100))};
}

bool AreEqual(const Message& a, const Message& b) {
  return a.envelope.view() == b.envelope.view() && a.payload.view() == b.payload.view();
}

// Moves one message through the ring, piece by piece.
Message Carry(Fixture& fixture, Message message) {
  fixture.writer.Push(std::move(message));
  Message taken;
  for (bool is_whole = false; !is_whole;) {
    REQUIRE(fixture.writer.Write() != RingResult::kBroken);
    REQUIRE(fixture.reader.Take(&taken, &is_whole, kAnyPayload) == RingResult::kMoved);
  }
  return taken;
}

void Publish(Fixture& fixture, uint32_t envelope, uint32_t payload, uint64_t zero) {
  std::memcpy(fixture.bytes.data(), &envelope, 4);
  std::memcpy(fixture.bytes.data() + 4, &payload, 4);
  std::memcpy(fixture.bytes.data() + 8, &zero, 8);
  fixture.head = 64;
}

RingResult TakeOnce(Fixture& fixture, size_t largest_payload = kAnyPayload) {
  Message message;
  bool is_whole = false;
  return fixture.reader.Take(&message, &is_whole, largest_payload);
}

TEST_CASE("A ring returns each message as it was put in, whatever its sizes and place") {
  Fixture fixture;
  // 37 messages of 64 to 2,560 bytes begin at every multiple of 64 of the ring.
  for (size_t i = 0; i < 600; ++i) {
    const size_t envelope = 1 + i * 7 % 300, payload = i * 31 % 2200;
    const auto first = static_cast<uint8_t>(i);
    const Message taken = Carry(fixture, MessageOf(envelope, payload, first));
    CHECK(AreEqual(taken, MessageOf(envelope, payload, first)));
  }
  CHECK(fixture.head == fixture.tail);
  CHECK(fixture.head % kRingLine == 0);
}

TEST_CASE("A ring keeps the order of messages that are queued together") {
  Fixture fixture;
  for (uint8_t i = 0; i < 20; ++i) fixture.writer.Push(MessageOf(40, 200, i));
  for (uint8_t i = 0; i < 20;) {
    fixture.writer.Write();
    Message taken;
    bool is_whole = false;
    REQUIRE(fixture.reader.Take(&taken, &is_whole, kAnyPayload) == RingResult::kMoved);
    if (is_whole) CHECK(AreEqual(taken, MessageOf(40, 200, i++)));
  }
  CHECK(fixture.writer.queued() == 0);
}

TEST_CASE("A writer stops at a full ring and goes on when the reader has made space") {
  Fixture fixture;
  fixture.writer.Push(MessageOf(10, 3 * kSize));
  CHECK(fixture.writer.Write() == RingResult::kMoved);
  CHECK(fixture.head == kSize);
  CHECK(fixture.writer.Write() == RingResult::kNothing);
  CHECK_FALSE(fixture.writer.HasSpace());
  CHECK(fixture.writer.queued() == 1);
  CHECK(TakeOnce(fixture) == RingResult::kMoved);
  CHECK(fixture.writer.HasSpace());
  CHECK(fixture.writer.Write() == RingResult::kMoved);
}

TEST_CASE("An empty ring has nothing to take") {
  Fixture fixture;
  CHECK_FALSE(fixture.reader.HasBytes());
  CHECK(TakeOnce(fixture) == RingResult::kNothing);
}

TEST_CASE("A reader gives up a head that is no head") {
  const uint64_t head = GENERATE(uint64_t{1}, uint64_t{63}, uint64_t{kSize + 64}, uint64_t{1} << 63,
                                 UINT64_MAX, UINT64_MAX - 63);
  Fixture fixture;
  fixture.head = head;
  CHECK(TakeOnce(fixture) == RingResult::kBroken);
  CHECK(fixture.tail == 0);
}

TEST_CASE("A writer gives up a tail that is no tail") {
  const uint64_t tail =
      GENERATE(uint64_t{1}, uint64_t{63}, uint64_t{kSize + 64}, uint64_t{1} << 63, UINT64_MAX);
  Fixture fixture;
  fixture.tail = tail;
  fixture.writer.Push(MessageOf(10, 3 * kSize));
  CHECK(fixture.writer.Write() == RingResult::kBroken);
}

TEST_CASE("A reader gives up a prefix that no message has") {
  Fixture fixture;
  SECTION("an envelope that is too long") {
    Publish(fixture, limits::kMaxEnvelopeBytes + 1, 0, 0);
    CHECK(TakeOnce(fixture) == RingResult::kBroken);
  }
  SECTION("a payload that is too long") {
    Publish(fixture, 10, limits::kMaxPayloadBytes + 1, 0);
    CHECK(TakeOnce(fixture) == RingResult::kBroken);
  }
  SECTION("a payload that is longer than the caller allows") {
    Publish(fixture, 10, 2000, 0);
    CHECK(TakeOnce(fixture, 1999) == RingResult::kBroken);
  }
  SECTION("words that are not zero") {
    Publish(fixture, 10, 10, 1);
    CHECK(TakeOnce(fixture) == RingResult::kBroken);
  }
}

TEST_CASE("A message that stops in the middle takes what was announced and is never whole") {
  Fixture fixture;
  Publish(fixture, 10, 2000, 0);
  CHECK(TakeOnce(fixture) == RingResult::kMoved);
  CHECK(fixture.reader.unfinished_bytes() == 2048);
  CHECK(TakeOnce(fixture) == RingResult::kNothing);
}

}  // namespace
}  // namespace b4mrl
