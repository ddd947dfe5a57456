// Messages whose bytes follow from a number, so that their receiver can check every byte. Pure
// functions. For tests.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>

#include "proto/base/rng.h"
#include "proto/wire/frame.h"

namespace b4mrl {

// Calls visit(offset, word, bytes) for the words of a frame of `size` bytes, the last of which may
// be cut short. False as soon as a call is.
template <typename Visit>
bool ForEachWord(size_t size, uint64_t number, Visit visit) {
  uint64_t word = MixSeeds(number, size);
  for (size_t at = 0; at < size; at += sizeof(word)) {
    if (!visit(at, word, std::min(size - at, sizeof(word)))) return false;
    word += 0x9E3779B97F4A7C15u;  // an odd number, so that words repeat after 2^64 of them
  }
  return true;
}

inline Frame NumberedFrame(size_t size, uint64_t number) {
  Frame frame = Frame::OfSize(size);
  std::byte* const bytes = frame.data();
  ForEachWord(size, number, [bytes](size_t at, uint64_t word, size_t count) {
    std::memcpy(bytes + at, &word, count);
    return true;
  });
  return frame;
}

inline bool IsNumberedFrame(const Frame& frame, size_t size, uint64_t number) {
  const std::byte* const bytes = frame.data();
  return frame.size() == size &&
         ForEachWord(size, number, [bytes](size_t at, uint64_t word, size_t count) {
           return std::memcmp(bytes + at, &word, count) == 0;
         });
}

inline Message NumberedMessage(size_t envelope_bytes, size_t payload_bytes, uint64_t number) {
  return {NumberedFrame(envelope_bytes, number), NumberedFrame(payload_bytes, number + 1)};
}

inline bool IsNumberedMessage(const Message& message, size_t envelope_bytes, size_t payload_bytes,
                              uint64_t number) {
  return IsNumberedFrame(message.envelope, envelope_bytes, number) &&
         IsNumberedFrame(message.payload, payload_bytes, number + 1);
}

}  // namespace b4mrl
