// Counts the memory of messages that a server has sent until their receivers have read them.
//
// ZeroMQ limits the messages that wait for a peer by their number alone: a thousand messages of the
// largest size take 64 GB. So a ROUTER counts the bytes of envelopes and payloads of
// limits::kCountedFrameBytes or more, from sending to the moment when ZeroMQ releases them, and
// refuses to send beyond a limit. A receiver may have as much to read as is left for all, so that
// one that does not read takes half at most. limits::kReservedUnreadBytes of each are let through
// whatever the others do. While nobody has anything to read, a message of any size passes, since
// it could wait for nothing better.
#pragma once

#include <atomic>
#include <cstddef>
#include <memory>
#include <string>
#include <unordered_map>

#include "proto/base/limits.h"
#include "proto/base/status.h"
#include "proto/wire/frame.h"

namespace b4mrl {

struct UnreadLimits {  // bytes
  size_t of_one = limits::kMaxUnreadBytes;
  size_t of_all = limits::kMaxUnreadBytesOfAll;
};

// Thread rule: the socket's thread alone uses this object. Counted frames may be destroyed by any
// thread, and may outlive this object.
class UnreadBytes {
 public:
  explicit UnreadBytes(UnreadLimits limits = {}) : limits_(limits) {}
  // Counts for receivers of another kind, with limits and of_all() in common with this object's.
  UnreadBytes Beside() const;

  // Replaces the frames of a message that count by frames with the same bytes, not copied, which
  // are counted for `receiver` until these frames and all that share their bytes are destroyed.
  // kLimitExceeded, and the message stays as it was, beyond the limits for one receiver or for all.
  Status Count(const std::string& receiver, Message* message);

  size_t of_all() const { return *all_; }
  size_t of(const std::string& receiver) const;

 private:
  using Counter = std::atomic<size_t>;
  struct Counted;  // kept by a counted frame: its bytes, and the counters to decrease
  // kLimitExceeded if a receiver that has `of_one` bytes to read must not get `bytes` more.
  Status Admit(size_t of_one, size_t bytes) const;
  // A frame with the bytes of `given`, which are counted until it is destroyed.
  Frame Wrap(const std::shared_ptr<Counter>& of_receiver, Frame given);
  static void Release(void* data, void* counted);
  std::shared_ptr<Counter>& CounterOf(const std::string& receiver);

  UnreadLimits limits_;
  std::shared_ptr<Counter> all_ = std::make_shared<Counter>(0);
  // Counters by receiver; the counts of some receivers may have become 0.
  std::unordered_map<std::string, std::shared_ptr<Counter>> receivers_;
};

}  // namespace b4mrl
