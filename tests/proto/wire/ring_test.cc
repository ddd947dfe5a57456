#include "proto/wire/ring.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <deque>
#include <fstream>
#include <limits>
#include <optional>
#include <thread>
#include <vector>

#include "proto/base/limits.h"
#include "proto/base/rng.h"
#include "tests/proto/wire/numbered_message.h"

namespace b4mrl {
namespace {

constexpr size_t kSmallRing = 1024;
constexpr size_t kPrefixBytes = 16;

// A ring in ordinary memory, between two areas that nobody may touch.
class GuardedRing {
 public:
  explicit GuardedRing(size_t size) : size_(size), memory_(size + 2 * kGuard, kUntouched) {}

  Ring ring() { return {&head, &tail, bytes(), size_}; }
  std::byte* bytes() { return memory_.data() + kGuard; }
  bool GuardsAreIntact() const {
    const auto is_untouched = [](std::byte byte) { return byte == kUntouched; };
    return std::all_of(memory_.begin(), memory_.begin() + kGuard, is_untouched) &&
           std::all_of(memory_.end() - kGuard, memory_.end(), is_untouched);
  }

  std::atomic<uint64_t> head{0}, tail{0};

 private:
  static constexpr size_t kGuard = 4096;
  static constexpr std::byte kUntouched{0xA5};

  size_t size_;
  std::vector<std::byte> memory_;
};

// Writes and takes by turns until a message has come; none if either end says that it cannot.
std::optional<Message> Carry(RingWriter& writer, RingReader& reader) {
  Message message;
  bool is_whole = false;
  while (!is_whole) {
    if (writer.Write() == RingResult::kBroken) return std::nullopt;
    if (reader.Take(&message, &is_whole) != RingResult::kMoved) return std::nullopt;
  }
  return message;
}

struct Words {
  uint32_t envelope = 0, payload = 0;
  uint64_t zero = 0;
};

// Writes a prefix and lets the head say that `published` bytes are there, as a peer may.
RingResult TakeAfter(GuardedRing* memory, const Words& prefix, uint64_t published) {
  std::memcpy(memory->bytes(), &prefix, sizeof(prefix));
  memory->head = published;
  RingReader reader(memory->ring());
  Message message;
  bool is_whole = false;
  return reader.Take(&message, &is_whole);
}

TEST_CASE("A message lies in the ring as the protocol says") {
  GuardedRing memory(kSmallRing);
  RingWriter writer(memory.ring());
  writer.Push({Frame::Copy("abc"), Frame::Copy("de")});
  CHECK(memory.head == 0);
  CHECK(writer.Write() == RingResult::kMoved);
  CHECK(memory.head == 64);
  const std::string_view bytes(reinterpret_cast<const char*>(memory.bytes()), 21);
  using namespace std::string_view_literals;
  CHECK(bytes == "\3\0\0\0\2\0\0\0\0\0\0\0\0\0\0\0abcde"sv);
  // With its prefix, a message of 48 bytes fills a line, and a message of 49 begins another one.
  writer.Push(NumberedMessage(48, 0, 1));
  writer.Push(NumberedMessage(0, 49, 2));
  CHECK(writer.Write() == RingResult::kMoved);
  CHECK(memory.head == 64 + 64 + 128);
  CHECK(writer.queued() == 0);
}

TEST_CASE("A message of any size arrives whole from any position of the ring") {
  const size_t lines = kSmallRing / kRingLine;
  for (size_t start = 0; start < lines; ++start) {
    for (size_t bytes = 0; bytes <= 2 * kSmallRing + kRingLine; ++bytes) {
      GuardedRing memory(kSmallRing);
      RingWriter writer(memory.ring());
      RingReader reader(memory.ring());
      for (size_t line = 0; line < start; ++line) {
        writer.Push(NumberedMessage(kRingLine - kPrefixBytes, 0, line));
        REQUIRE(Carry(writer, reader));
      }
      REQUIRE(memory.tail == start * kRingLine);
      const size_t envelope = bytes / 3, payload = bytes - envelope;
      writer.Push(NumberedMessage(envelope, payload, bytes));
      const std::optional<Message> message = Carry(writer, reader);
      INFO(bytes << " bytes from line " << start);
      REQUIRE(message);
      REQUIRE(IsNumberedMessage(*message, envelope, payload, bytes));
      REQUIRE(memory.head == memory.tail);
      REQUIRE(writer.queued() == 0);
      REQUIRE(reader.unfinished_bytes() == 0);
      REQUIRE(memory.GuardsAreIntact());
    }
  }
}

TEST_CASE("Messages of 1 B to 64 MiB arrive through the smallest ring of a door") {
  GuardedRing memory(limits::kMinRingBytes);
  RingWriter writer(memory.ring());
  RingReader reader(memory.ring());
  for (size_t power = 1; power <= limits::kMaxPayloadBytes; power *= 2) {
    for (const size_t bytes : {power - 1, power, power + 1}) {
      if (bytes > limits::kMaxPayloadBytes) continue;
      const size_t envelope = std::min(bytes, limits::kMaxEnvelopeBytes);
      writer.Push(NumberedMessage(envelope, bytes, bytes));
      const std::optional<Message> message = Carry(writer, reader);
      INFO(bytes << " bytes");
      REQUIRE(message);
      REQUIRE(IsNumberedMessage(*message, envelope, bytes, bytes));
    }
  }
  CHECK(memory.GuardsAreIntact());
}

TEST_CASE("Whatever the order of writing and taking, messages arrive once and in order") {
  constexpr size_t kRing = 4096;
  constexpr int kRounds = 200'000;
  GuardedRing memory(kRing);
  RingWriter writer(memory.ring());
  RingReader reader(memory.ring());
  Rng rng(1, "ring test");
  std::deque<std::array<size_t, 2>> sizes;  // of the messages on their way
  uint64_t pushed = 0, taken = 0;
  for (int round = 0; round < kRounds; ++round) {
    if (sizes.size() < 20 && rng.Below(3) == 0) {
      const auto bytes = static_cast<size_t>(std::pow(20'000, rng.Uniform()));
      sizes.push_back({rng.Below(bytes + 1), bytes});
      writer.Push(NumberedMessage(sizes.back()[0], sizes.back()[1], pushed++));
    }
    if (rng.Below(2) == 0) {
      const RingResult result = writer.Write();
      REQUIRE(result != RingResult::kBroken);
      // What is left waits for space, and HasSpace tells when there is some.
      if (writer.queued() > 0) {
        REQUIRE(memory.head - memory.tail == kRing);
        REQUIRE_FALSE(writer.HasSpace());
      }
    }
    if (rng.Below(2) == 0) {
      const bool had_bytes = reader.HasBytes();
      REQUIRE(had_bytes == (memory.head != memory.tail));
      Message message;
      bool is_whole = false;
      const RingResult result = reader.Take(&message, &is_whole);
      REQUIRE(result == (had_bytes ? RingResult::kMoved : RingResult::kNothing));
      if (had_bytes && writer.queued() > 0) REQUIRE(writer.HasSpace());
      if (!is_whole) continue;
      REQUIRE(IsNumberedMessage(message, sizes.front()[0], sizes.front()[1], taken++));
      sizes.pop_front();
    }
  }
  CHECK(taken > kRounds / 20);
  CHECK(memory.GuardsAreIntact());
}

// A writer and a reader on threads of their own.
void ExchangeOnThreads(uint64_t messages, double largest_bytes) {
  GuardedRing memory(limits::kMinRingBytes);
  const auto size_of = [&](uint64_t number) {
    return static_cast<size_t>(std::pow(largest_bytes, Rng(7, "sizes", number).Uniform()));
  };
  std::thread writing([&] {
    RingWriter writer(memory.ring());
    for (uint64_t number = 0; number < messages; ++number) {
      writer.Push(NumberedMessage(number % 50, size_of(number), number));
      while (writer.queued() > 0) {
        if (writer.Write() != RingResult::kMoved) std::this_thread::yield();
      }
    }
  });
  RingReader reader(memory.ring());
  uint64_t wrong = 0;
  for (uint64_t number = 0; number < messages;) {
    Message message;
    bool is_whole = false;
    if (reader.Take(&message, &is_whole) == RingResult::kNothing) {
      std::this_thread::yield();
    }
    if (!is_whole) continue;
    wrong += IsNumberedMessage(message, number % 50, size_of(number), number) ? 0 : 1;
    ++number;
  }
  writing.join();
  CHECK(wrong == 0);
  CHECK(memory.GuardsAreIntact());
}

TEST_CASE("Two threads exchange messages of 1 B to 64 KiB and a few of up to 16 MiB") {
  ExchangeOnThreads(10'000, 65'536);
  ExchangeOnThreads(10, 16 << 20);
}

TEST_CASE("Two threads exchange a million messages and a hundred of up to 64 MiB", "[.][long]") {
  ExchangeOnThreads(1'000'000, 65'536);
  ExchangeOnThreads(100, 64 << 20);
}

TEST_CASE("A writer stops at a full ring and goes on when the reader has made space") {
  GuardedRing memory(kSmallRing);
  RingWriter writer(memory.ring());
  RingReader reader(memory.ring());
  writer.Push(NumberedMessage(10, 3 * kSmallRing, 1));
  CHECK(writer.Write() == RingResult::kMoved);
  CHECK(memory.head == kSmallRing);
  CHECK(writer.Write() == RingResult::kNothing);
  CHECK_FALSE(writer.HasSpace());
  CHECK(writer.queued() == 1);
  Message message;
  bool is_whole = true;
  CHECK(reader.Take(&message, &is_whole) == RingResult::kMoved);
  CHECK_FALSE(is_whole);
  CHECK(writer.HasSpace());
  CHECK(writer.Write() == RingResult::kMoved);
}

TEST_CASE("An empty ring gives nothing") {
  GuardedRing memory(kSmallRing);
  RingReader reader(memory.ring());
  RingWriter writer(memory.ring());
  Message message;
  bool is_whole = true;
  CHECK(reader.Take(&message, &is_whole) == RingResult::kNothing);
  CHECK_FALSE(is_whole);
  CHECK(writer.Write() == RingResult::kNothing);
}

TEST_CASE("A head that no writer can have breaks the ring") {
  GuardedRing memory(kSmallRing);
  RingWriter writer(memory.ring());
  RingReader reader(memory.ring());
  for (int i = 0; i < 20; ++i) {  // more than once round
    writer.Push(NumberedMessage(10, 20, 1));
    REQUIRE(Carry(writer, reader));
  }
  const uint64_t tail = memory.tail;
  const uint64_t head = GENERATE_COPY(tail + 1, tail + 63, tail + 65, tail + kSmallRing + 64,
                                      tail + kSmallRing + 1, tail - 1, tail - 64, uint64_t{0},
                                      uint64_t{1} << 63, std::numeric_limits<uint64_t>::max());
  CAPTURE(tail, head);
  memory.head = head;
  Message message;
  bool is_whole = true;
  CHECK(reader.Take(&message, &is_whole) == RingResult::kBroken);
  CHECK_FALSE(is_whole);
  CHECK(memory.tail == tail);
}

TEST_CASE("A tail that no reader can have breaks the ring") {
  GuardedRing memory(kSmallRing);
  RingWriter writer(memory.ring());
  writer.Push(NumberedMessage(0, 3 * kSmallRing, 1));
  REQUIRE(writer.Write() == RingResult::kMoved);
  REQUIRE(memory.head == kSmallRing);
  const uint64_t tail =
      GENERATE(uint64_t{1}, uint64_t{63}, uint64_t{kSmallRing + 64}, uint64_t{kSmallRing + 1},
               uint64_t{1} << 63, std::numeric_limits<uint64_t>::max() - 63);
  CAPTURE(tail);
  memory.tail = tail;
  CHECK(writer.Write() == RingResult::kBroken);
  // Nor does a second try go by the tail that was refused.
  CHECK(writer.Write() == RingResult::kBroken);
  CHECK(memory.head == kSmallRing);
  CHECK(memory.GuardsAreIntact());
}

TEST_CASE("Lengths beyond the limits break the ring, and the limits themselves do not") {
  constexpr auto kEnvelope = static_cast<uint32_t>(limits::kMaxEnvelopeBytes);
  constexpr auto kPayload = static_cast<uint32_t>(limits::kMaxPayloadBytes);
  GuardedRing memory(kSmallRing);
  CHECK(TakeAfter(&memory, {kEnvelope, kPayload, 0}, 64) == RingResult::kMoved);
  for (const Words& prefix : {Words{kEnvelope + 1, 0, 0},
                              {0, kPayload + 1, 0},
                              {UINT32_MAX, UINT32_MAX, 0},
                              {1, 1, 1},
                              {1, 1, uint64_t{1} << 63}}) {
    CAPTURE(prefix.envelope, prefix.payload, prefix.zero);
    CHECK(TakeAfter(&memory, prefix, 64) == RingResult::kBroken);
  }
}

TEST_CASE("A length that is announced and not sent is counted, and takes no memory") {
  const auto resident_pages = [] {
    size_t all = 0, resident = 0;
    std::ifstream("/proc/self/statm") >> all >> resident;
    return resident;
  };
  GuardedRing memory(kSmallRing);
  const Words prefix{0, static_cast<uint32_t>(limits::kMaxPayloadBytes), 0};
  std::memcpy(memory.bytes(), &prefix, sizeof(prefix));
  memory.head = 64;
  RingReader reader(memory.ring());
  Message message;
  bool is_whole = true;
  const size_t before = resident_pages();
  REQUIRE(reader.Take(&message, &is_whole) == RingResult::kMoved);
  CHECK_FALSE(is_whole);
  CHECK(reader.unfinished_bytes() >= limits::kMaxPayloadBytes);
  CHECK(reader.Take(&message, &is_whole) == RingResult::kNothing);
  CHECK_FALSE(is_whole);
  // AddressSanitizer's notes about memory take an eighth of it.
  const size_t grown = resident_pages() - std::min(resident_pages(), before);
  CHECK(grown * static_cast<size_t>(getpagesize()) < limits::kMaxPayloadBytes / 2);
}

TEST_CASE("Bytes that change after they were read change no length") {
  GuardedRing memory(kSmallRing);
  RingWriter writer(memory.ring());
  RingReader reader(memory.ring());
  writer.Push(NumberedMessage(100, 3 * kSmallRing, 1));
  REQUIRE(writer.Write() == RingResult::kMoved);
  Message message;
  bool is_whole = false;
  REQUIRE(reader.Take(&message, &is_whole) == RingResult::kMoved);
  std::memset(memory.bytes(), 0xFF, kSmallRing);
  const std::optional<Message> changed = Carry(writer, reader);
  REQUIRE(changed);
  CHECK(changed->envelope.size() == 100);
  CHECK(changed->payload.size() == 3 * kSmallRing);
}

TEST_CASE("Random words and bytes of a peer touch nothing outside the ring") {
  constexpr int kRounds = 100'000;
  Rng rng(2, "hostile peer");
  // Mostly distances that are allowed, or nearly so.
  const auto near = [&](uint64_t position) {
    switch (rng.Below(4)) {
      case 0:
        return position + rng.Below(2 * kSmallRing);
      case 1:
        return rng.NextUint64();
      default:
        return position + kRingLine * rng.Below(kSmallRing / kRingLine + 2);
    }
  };
  GuardedRing up(kSmallRing), down(kSmallRing);
  std::optional<RingReader> reader;
  std::optional<RingWriter> writer;
  int broken = 0, whole = 0;
  for (int round = 0; round < kRounds; ++round) {
    if (!reader) {
      up.head = up.tail = 0;
      down.head = down.tail = 0;
      reader.emplace(up.ring());
      writer.emplace(down.ring());
    }
    // A prefix of a message at every line, most of them of short messages.
    for (size_t line = 0; line < kSmallRing; line += kRingLine) {
      const Words prefix{static_cast<uint32_t>(rng.Below(300)),
                         static_cast<uint32_t>(rng.Below(3000)), rng.Below(10) == 0 ? 1u : 0u};
      std::memcpy(up.bytes() + line, &prefix, sizeof(prefix));
    }
    up.head = near(up.tail);
    down.tail = near(down.tail);
    writer->Push(NumberedMessage(rng.Below(100), rng.Below(2000), 1));
    Message message;
    bool is_whole = false;
    const RingResult taken = reader->Take(&message, &is_whole);
    const RingResult written = writer->Write();
    REQUIRE(up.GuardsAreIntact());
    REQUIRE(down.GuardsAreIntact());
    if (is_whole) {
      ++whole;
      REQUIRE(message.envelope.size() < 300);
      REQUIRE(message.payload.size() < 3000);
    }
    if (taken != RingResult::kBroken && written != RingResult::kBroken) continue;
    ++broken;
    reader.reset();
    writer.reset();
  }
  CHECK(broken > 1000);
  CHECK(whole > 1000);
}

}  // namespace
}  // namespace b4mrl
