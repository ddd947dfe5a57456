// Counts the memory of large payloads that a server has sent until their receivers have read them.
//
// ZeroMQ limits the messages that wait for a peer by their number alone: a thousand of the longest
// take 64 GB. So a ROUTER counts the bytes of payloads of limits::kCountedPayloadBytes or more,
// from sending to the moment when ZeroMQ releases them, and refuses to send beyond a limit.
#pragma once

#include <atomic>
#include <cstddef>
#include <memory>
#include <string>
#include <unordered_map>

#include "proto/base/status.h"
#include "proto/wire/frame.h"

namespace b4mrl {

// Thread rule: one thread, that of the socket. Counted frames may be destroyed by any thread, and
// may outlive this object.
class UnreadBytes {
 public:
  // The same bytes, not copied, counted for `receiver` until the frame (and every frame that shares
  // them) is destroyed. kLimitExceeded: this receiver or all together would hold more than
  // limits::kMaxUnreadBytes or kMaxUnreadBytesOfAll; `payload` is lost then.
  Result<Frame> Count(const std::string& receiver, Frame payload);

  size_t of_all() const { return *all_; }
  size_t of(const std::string& receiver) const;

 private:
  using Counter = std::atomic<size_t>;
  struct Counted;  // travels with a frame and says whose bytes to uncount
  static void Release(void* data, void* counted);
  std::shared_ptr<Counter>& CounterOf(const std::string& receiver);

  std::shared_ptr<Counter> all_ = std::make_shared<Counter>(0);
  // By receiver, including some whose count is 0 by now.
  std::unordered_map<std::string, std::shared_ptr<Counter>> receivers_;
};

}  // namespace b4mrl
