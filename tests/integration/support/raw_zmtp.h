// ZeroMQ's wire protocol (ZMTP 3.0, NULL mechanism) by hand over a plain tcp socket, so that a test
// can send what no library would. Blocking calls with a deadline. Thread rule: one thread.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "proto/base/unique_fd.h"

namespace b4mrl {

class RawZmtp {
 public:
  // Connects to "tcp://127.0.0.1:PORT"; says nothing yet.
  explicit RawZmtp(const std::string& address);

  bool connected() const { return fd_.valid(); }
  // False when the peer has hung up.
  bool SendBytes(std::string_view bytes);
  // The greeting and READY of a DEALER; reads those of the peer. `identity`: the routing id that a
  // ROUTER shall know it by, if it is not "".
  bool ShakeHands(std::string_view identity = {});
  // A message of these parts.
  bool SendMessage(const std::vector<std::string>& parts);
  // The parts of the next message, commands skipped; empty after the deadline or a hang-up.
  std::vector<std::string> Receive(int64_t deadline_ms);
  // Reads until the peer hangs up; false after the deadline.
  bool AwaitHangUp(int64_t deadline_ms);
  // Whether the peer has hung up by now.
  bool HasHungUp() const;

  static std::string Greeting();
  static std::string Ready(std::string_view identity = {});
  static std::string FrameOf(std::string_view body, bool more, bool command = false);

 private:
  bool ReadExactly(size_t size, std::string* out, int64_t deadline_ms);

  UniqueFd fd_;
};

}  // namespace b4mrl
