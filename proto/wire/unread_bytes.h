// Counts the memory of messages that a server has sent until their receivers have read them.
//
// ZeroMQ limits the messages that wait for a peer by their number alone: a thousand messages of the
// largest size take 64 GB. So a ROUTER counts the bytes of envelopes and payloads of
// limits::kCountedFrameBytes or more, from sending to the moment when ZeroMQ releases them, and
// refuses to send beyond a limit.
#pragma once

#include <atomic>
#include <cstddef>
#include <memory>
#include <string>
#include <unordered_map>

#include "proto/base/status.h"
#include "proto/wire/frame.h"

namespace b4mrl {

// Thread rule: the socket's thread alone uses this object. Counted frames may be destroyed by any
// thread, and may outlive this object.
class UnreadBytes {
 public:
  // Replaces the frames of a message that count by frames with the same bytes, not copied.
  // kLimitExceeded, and the message is lost, as for a frame.
  Status Count(const std::string& receiver, Message* message);
  // Returns a frame with the bytes of `given`, not copied, which are counted for `receiver` until
  // the frame and all frames that share its bytes are destroyed. kLimitExceeded, and `given` is
  // lost, beyond limits::kMaxUnreadBytes for one receiver or kMaxUnreadBytesOfAll for all.
  Result<Frame> Count(const std::string& receiver, Frame given);

  size_t of_all() const { return *all_; }
  size_t of(const std::string& receiver) const;

 private:
  using Counter = std::atomic<size_t>;
  struct Counted;  // kept by a counted frame: its bytes, and the counters to decrease
  static void Release(void* data, void* counted);
  std::shared_ptr<Counter>& CounterOf(const std::string& receiver);

  std::shared_ptr<Counter> all_ = std::make_shared<Counter>(0);
  // Counters by receiver; the counts of some receivers may have become 0.
  std::unordered_map<std::string, std::shared_ptr<Counter>> receivers_;
};

}  // namespace b4mrl
