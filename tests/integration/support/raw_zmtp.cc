#include "tests/integration/support/raw_zmtp.h"

#include <poll.h>
#include <sys/socket.h>

#include "proto/base/clock.h"
#include "proto/wire/socket.h"
#include "tests/loopback.h"

namespace b4mrl {
namespace {

// ZMTP 3.0: bits of a frame's flags.
constexpr uint8_t kMore = 1;
constexpr uint8_t kLong = 2;
constexpr uint8_t kCommand = 4;
constexpr size_t kGreetingBytes = 64;
constexpr int64_t kHandshakeMs = 10'000;

std::string BigEndian(uint64_t value, int bytes) {
  std::string text;
  for (int i = bytes - 1; i >= 0; --i) text += static_cast<char>(value >> (8 * i));
  return text;
}

}  // namespace

RawZmtp::RawZmtp(const std::string& address) {
  const Result<TcpAddress> parsed = ParseTcpAddress(address);
  if (!parsed.ok()) return;
  fd_ = ConnectToLoopback(parsed->port);
}

bool RawZmtp::SendBytes(std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t sent = send(fd_.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (sent <= 0) return false;
    bytes.remove_prefix(static_cast<size_t>(sent));
  }
  return true;
}

std::string RawZmtp::Greeting() {
  std::string greeting = "\xff" + std::string(8, '\0') + "\x7f";
  greeting += '\x03';  // version 3.0
  greeting += '\0';
  greeting += "NULL" + std::string(16, '\0');
  greeting.resize(kGreetingBytes, '\0');
  return greeting;
}

std::string RawZmtp::Ready(std::string_view identity) {
  std::string body = "\x05READY\x0bSocket-Type";
  body += BigEndian(6, 4) + "DEALER";
  if (!identity.empty()) {
    body += "\x08Identity" + BigEndian(identity.size(), 4) + std::string(identity);
  }
  return FrameOf(body, false, true);
}

std::string RawZmtp::FrameOf(std::string_view body, bool more, bool command) {
  const bool is_long = body.size() > 255;
  const int flags = (more ? kMore : 0) | (is_long ? kLong : 0) | (command ? kCommand : 0);
  return std::string(1, static_cast<char>(flags)) + BigEndian(body.size(), is_long ? 8 : 1) +
         std::string(body);
}

bool RawZmtp::ShakeHands(std::string_view identity) {
  std::string greeting;
  return SendBytes(Greeting() + Ready(identity)) &&
         ReadExactly(kGreetingBytes, &greeting, kHandshakeMs);
}

bool RawZmtp::SendMessage(const std::vector<std::string>& parts) {
  std::string bytes;
  for (size_t i = 0; i < parts.size(); ++i) bytes += FrameOf(parts[i], i + 1 < parts.size());
  return SendBytes(bytes);
}

bool RawZmtp::ReadExactly(size_t size, std::string* out, int64_t deadline_ms) {
  const Deadline deadline = Deadline::AfterMs(deadline_ms);
  out->clear();
  while (out->size() < size && !deadline.expired()) {
    pollfd item{fd_.get(), POLLIN, 0};
    if (poll(&item, 1, static_cast<int>(deadline.remaining_ms())) <= 0) continue;
    char buffer[4096];
    const ssize_t count = recv(fd_.get(), buffer, std::min(sizeof(buffer), size - out->size()), 0);
    if (count <= 0) return false;
    out->append(buffer, static_cast<size_t>(count));
  }
  return out->size() == size;
}

std::vector<std::string> RawZmtp::Receive(int64_t deadline_ms) {
  std::vector<std::string> parts;
  std::string head, size, body;
  while (ReadExactly(1, &head, deadline_ms)) {
    const uint8_t flags = static_cast<uint8_t>(head[0]);
    if (!ReadExactly((flags & kLong) != 0 ? 8 : 1, &size, deadline_ms)) return {};
    uint64_t length = 0;
    for (const char byte : size) length = length << 8 | static_cast<uint8_t>(byte);
    if (!ReadExactly(length, &body, deadline_ms)) return {};
    if ((flags & kCommand) != 0) continue;
    parts.push_back(body);
    if ((flags & kMore) == 0) return parts;
  }
  return {};
}

bool RawZmtp::AwaitHangUp(int64_t deadline_ms) {
  std::string byte;
  const Deadline deadline = Deadline::AfterMs(deadline_ms);
  while (ReadExactly(1, &byte, deadline.remaining_ms())) {
  }
  return !deadline.expired();
}

bool RawZmtp::HasHungUp() const {
  pollfd waiting{fd_.get(), POLLRDHUP, 0};
  return poll(&waiting, 1, 0) > 0;
}

}  // namespace b4mrl
