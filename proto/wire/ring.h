// A ring of shared memory that carries messages from one process to another: the byte pipe of the
// local door (proto/wire/door.h).
//
// A message is a prefix of 16 bytes (u32 bytes of the envelope, u32 bytes of the payload, u64 zero,
// little endian), the envelope, the payload, and padding to a multiple of 64 bytes. So positions
// are multiples of 64 and a prefix never wraps. `head` counts the bytes that the writer has
// published, `tail` those that the reader has taken; both only grow. A message that is longer than
// the ring's free space is published in lines of 64 bytes as space comes, and both ends keep their
// half of it privately.
//
// Each end trusts its own private position alone. What the peer wrote is copied once and then
// checked, and whatever its bytes are, an end reads and writes within the ring.
//
// Thread rule: an end belongs to one thread. The memory outlives the ends.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <deque>

#include "proto/wire/frame.h"

namespace b4mrl {

// A ring in shared memory: two positions on cache lines of their own, and the bytes.
struct Ring {
  std::atomic<uint64_t>* head = nullptr;
  std::atomic<uint64_t>* tail = nullptr;
  std::byte* bytes = nullptr;
  size_t size = 0;  // a power of two, at least kRingLine
};

inline constexpr size_t kRingLine = 64;  // positions are multiples of this

// What an end did, or why it cannot go on.
enum class RingResult : uint8_t {
  kNothing,  // no bytes waited, or no space
  kMoved,    // bytes were published or taken
  kBroken,   // the peer's words or bytes are no ring's: give the ring up
};

class RingWriter {
 public:
  explicit RingWriter(const Ring& ring) : ring_(ring) {}

  // Queues a message. Its frames are kept, not copied, until all bytes are in the ring.
  void Push(Message message) { queue_.push_back(std::move(message)); }
  // Messages that are not wholly in the ring.
  size_t queued() const { return queue_.size(); }
  // Whether the reader has made space since Write last found too little.
  bool HasSpace() const { return ring_.tail->load(std::memory_order_acquire) != known_tail_; }
  // Publishes as many bytes of the queued messages as there is space for.
  RingResult Write();

 private:
  // Looks how far the reader is; false, and forgotten, if its word cannot be.
  bool ReadTail();
  void Copy(const Message& message, size_t begin, size_t count);
  void CopyPart(size_t* position, const void* bytes, size_t count);

  Ring ring_;
  uint64_t head_ = 0;        // own position
  uint64_t known_tail_ = 0;  // the reader's position, when it was last read
  std::deque<Message> queue_;
  size_t written_ = 0;  // bytes of the first message that are in the ring
};

class RingReader {
 public:
  explicit RingReader(const Ring& ring) : ring_(ring) {}

  // Whether the writer has published bytes that were not taken.
  bool HasBytes() const { return ring_.head->load(std::memory_order_acquire) != tail_; }
  // Takes what is there. kMoved with `*is_whole`: `*message` is the next message; kMoved without:
  // more bytes of it are to come. A message beyond limits::kMaxEnvelopeBytes or kMaxPayloadBytes
  // breaks the ring.
  RingResult Take(Message* message, bool* is_whole);
  // Bytes of memory that a message which has not come entirely may take; 0 if there is none.
  size_t unfinished_bytes() const { return total_; }

 private:
  bool Begin();
  void Copy(size_t begin, size_t count);
  void CopyPart(size_t* position, std::byte* to, size_t count) const;

  Ring ring_;
  uint64_t tail_ = 0;  // own position
  Message message_;    // the message that is being taken
  size_t total_ = 0;   // its bytes with prefix and padding; 0 between two messages
  size_t taken_ = 0;
};

}  // namespace b4mrl
