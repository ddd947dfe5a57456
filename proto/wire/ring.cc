#include "proto/wire/ring.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>

#include "proto/base/limits.h"

namespace b4mrl {
namespace {

// The first bytes of a message.
struct Prefix {
  uint32_t envelope = 0;
  uint32_t payload = 0;
  uint64_t zero = 0;
};
static_assert(sizeof(Prefix) == 16);

size_t BytesInRing(size_t envelope, size_t payload) {
  return (sizeof(Prefix) + envelope + payload + kRingLine - 1) / kRingLine * kRingLine;
}

// Whether `bytes` can lie between the two ends of a ring of `size` bytes.
bool IsDistance(uint64_t bytes, size_t size) { return bytes <= size && bytes % kRingLine == 0; }

// Calls copy(part, offset in the part, bytes) for the parts of a message, of the given sizes, that
// lie in the message's bytes `begin` to `begin` + `count`.
template <typename CopyFunction>
void ForEachPart(const std::array<size_t, 3>& sizes, size_t begin, size_t count,
                 CopyFunction copy) {
  const size_t end = begin + count;
  size_t start = 0;  // of the part
  for (size_t part = 0; part < sizes.size(); ++part) {
    const size_t from = std::max(begin, start), to = std::min(end, start + sizes[part]);
    if (from < to) copy(part, from - start, to - from);
    start += sizes[part];
  }
}

}  // namespace

bool RingWriter::ReadTail() {
  const uint64_t tail = ring_.tail->load(std::memory_order_acquire);
  if (!IsDistance(head_ - tail, ring_.size)) return false;
  known_tail_ = tail;
  return true;
}

RingResult RingWriter::Write() {
  RingResult result = RingResult::kNothing;
  while (!queue_.empty()) {
    const Message& message = queue_.front();
    const size_t total = BytesInRing(message.envelope.size(), message.payload.size());
    const size_t left = total - written_;
    if (ring_.size - (head_ - known_tail_) < left && !ReadTail()) return RingResult::kBroken;
    const size_t count = std::min(left, ring_.size - static_cast<size_t>(head_ - known_tail_));
    if (count == 0) return result;
    Copy(message, written_, count);
    head_ += count;
    ring_.head->store(head_, std::memory_order_release);
    result = RingResult::kMoved;
    written_ += count;
    if (written_ < total) continue;
    queue_.pop_front();
    written_ = 0;
  }
  return result;
}

void RingWriter::Copy(const Message& message, size_t begin, size_t count) {
  const Prefix prefix{static_cast<uint32_t>(message.envelope.size()),
                      static_cast<uint32_t>(message.payload.size()), 0};
  const std::array<const void*, 3> parts = {&prefix, message.envelope.data(),
                                            message.payload.data()};
  size_t position = head_ & (ring_.size - 1);
  ForEachPart({sizeof(prefix), message.envelope.size(), message.payload.size()}, begin, count,
              [&](size_t part, size_t offset, size_t bytes) {
                CopyPart(&position, static_cast<const std::byte*>(parts[part]) + offset, bytes);
              });
}

void RingWriter::CopyPart(size_t* position, const void* bytes, size_t count) {
  const size_t straight = std::min(count, ring_.size - *position);
  std::memcpy(ring_.bytes + *position, bytes, straight);
  std::memcpy(ring_.bytes, static_cast<const std::byte*>(bytes) + straight, count - straight);
  *position = (*position + count) & (ring_.size - 1);
}

RingResult RingReader::Take(Message* message, bool* is_whole) {
  *is_whole = false;
  const uint64_t waiting = ring_.head->load(std::memory_order_acquire) - tail_;
  if (waiting == 0) return RingResult::kNothing;
  if (!IsDistance(waiting, ring_.size)) return RingResult::kBroken;
  if (total_ == 0 && !Begin()) return RingResult::kBroken;
  const size_t count = std::min<size_t>(waiting, total_ - taken_);
  Copy(taken_, count);
  taken_ += count;
  tail_ += count;
  ring_.tail->store(tail_, std::memory_order_release);
  if (taken_ == total_) {
    *message = std::move(message_);
    *is_whole = true;
    total_ = taken_ = 0;
  }
  return RingResult::kMoved;
}

bool RingReader::Begin() {
  Prefix prefix;  // a copy: the peer may change the ring's bytes at any moment
  std::memcpy(&prefix, ring_.bytes + (tail_ & (ring_.size - 1)), sizeof(prefix));
  if (prefix.envelope > limits::kMaxEnvelopeBytes || prefix.payload > limits::kMaxPayloadBytes ||
      prefix.zero != 0) {
    return false;
  }
  // Large frames are fresh memory, which the kernel provides page by page as bytes are copied, so a
  // length that is announced and never sent takes none.
  message_ = {Frame::OfSize(prefix.envelope), Frame::OfSize(prefix.payload)};
  total_ = BytesInRing(prefix.envelope, prefix.payload);
  return true;
}

void RingReader::Copy(size_t begin, size_t count) {
  Prefix skipped;
  const std::array<std::byte*, 3> parts = {reinterpret_cast<std::byte*>(&skipped),
                                           message_.envelope.data(), message_.payload.data()};
  size_t position = tail_ & (ring_.size - 1);
  ForEachPart({sizeof(skipped), message_.envelope.size(), message_.payload.size()}, begin, count,
              [&](size_t part, size_t offset, size_t bytes) {
                CopyPart(&position, parts[part] + offset, bytes);
              });
}

void RingReader::CopyPart(size_t* position, std::byte* to, size_t count) const {
  const size_t straight = std::min(count, ring_.size - *position);
  std::memcpy(to, ring_.bytes + *position, straight);
  std::memcpy(to + straight, ring_.bytes, count - straight);
  *position = (*position + count) & (ring_.size - 1);
}

}  // namespace b4mrl
