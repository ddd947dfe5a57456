#include "proto/wire/unread_bytes.h"

#include <catch2/catch.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "proto/base/limits.h"

namespace b4mrl {
namespace {

// A message with this payload, once it is counted; nothing if it is refused.
std::optional<Message> Counted(UnreadBytes& unread, const std::string& receiver, Frame payload) {
  Message message{Frame(), std::move(payload)};
  const Status status = unread.Count(receiver, &message);
  if (status.ok()) return message;
  CHECK(status.code() == StatusCode::kLimitExceeded);
  return std::nullopt;
}

// As many messages as are let through, each with a share of `payload`, so that they need no memory.
std::vector<Message> CountUntilRefused(UnreadBytes& unread, const std::string& receiver,
                                       Frame& payload) {
  std::vector<Message> counted;
  while (std::optional<Message> message = Counted(unread, receiver, payload.Share())) {
    counted.push_back(std::move(*message));
  }
  return counted;
}

TEST_CASE("a counted frame has its bytes until it is destroyed, and small frames do not count") {
  UnreadBytes unread;
  const std::string text(limits::kCountedFrameBytes, 'x');
  Message message{Frame::Copy(text.substr(1)), Frame::Copy(text)};
  REQUIRE(unread.Count("peer", &message).ok());
  CHECK(message.envelope.view() == text.substr(1));
  CHECK(message.payload.view() == text);
  CHECK(unread.of("peer") == limits::kCountedFrameBytes);
  CHECK(unread.of_all() == limits::kCountedFrameBytes);
  message = Message();
  CHECK(unread.of("peer") == 0);
  CHECK(unread.of_all() == 0);
}

TEST_CASE("a peer is refused more unread bytes than the limit until it has read some") {
  UnreadBytes unread;
  Frame payload = Frame::OfSize(limits::kMaxPayloadBytes);
  std::vector<Message> counted = CountUntilRefused(unread, "slow", payload);
  CHECK(unread.of("slow") == limits::kMaxUnreadBytes);
  CHECK(Counted(unread, "other", payload.Share()));
  counted.pop_back();
  CHECK(Counted(unread, "slow", payload.Share()));
}

TEST_CASE("peers together are refused more unread bytes than their limit and their reserves") {
  UnreadBytes unread;
  Frame large = Frame::OfSize(limits::kMaxPayloadBytes);
  Frame small = Frame::OfSize(limits::kReservedUnreadBytes / 2);
  std::vector<std::vector<Message>> counted;
  for (int peer = 0; peer < 64; ++peer) {
    counted.push_back(CountUntilRefused(unread, std::to_string(peer), large));
  }
  CHECK(unread.of_all() <= limits::kMaxUnreadBytesOfAll);
  for (int peer = 0; peer < 10'000; ++peer) {
    counted.push_back(CountUntilRefused(unread, std::to_string(peer), small));
  }
  CHECK(unread.of_all() <= limits::kMaxUnreadBytesOfAll + 10'000 * limits::kReservedUnreadBytes);
  // Whoever reads gets its replies nevertheless, if they are small.
  CHECK(CountUntilRefused(unread, "late", small).size() == 2);
  CHECK_FALSE(Counted(unread, "late", large.Share()));
  counted.clear();
  CHECK(unread.of_all() == 0);
  CHECK(Counted(unread, "late", large.Share()));
}

TEST_CASE("each of two peers that do not read takes a third of the limit, one alone half") {
  constexpr size_t kBytes = limits::kReservedUnreadBytes;
  UnreadBytes unread({.of_one = 90 * kBytes, .of_all = 90 * kBytes});
  Frame payload = Frame::OfSize(kBytes);
  std::vector<Message> counted = CountUntilRefused(unread, "a", payload);
  CHECK(counted.size() == 45);
  counted.resize(30);  // what it has read by now, and what it may have then
  const std::vector<Message> others = CountUntilRefused(unread, "b", payload);
  CHECK(others.size() == 30);
  CHECK_FALSE(Counted(unread, "a", payload.Share()));
}

TEST_CASE("a message above the limits passes while nobody has anything to read") {
  UnreadBytes unread({.of_one = 100, .of_all = 200});
  Message large{Frame::OfSize(2 * limits::kCountedFrameBytes),
                Frame::OfSize(2 * limits::kCountedFrameBytes)};
  REQUIRE(unread.Count("a", &large).ok());
  CHECK(unread.of("a") == 4 * limits::kCountedFrameBytes);
  CHECK_FALSE(Counted(unread, "b", Frame::OfSize(limits::kReservedUnreadBytes + 1)));
  large = Message();
  CHECK(Counted(unread, "b", Frame::OfSize(limits::kReservedUnreadBytes + 1)));
}

TEST_CASE("counts beside each other know receivers apart and share the limit of all") {
  constexpr size_t kBytes = limits::kReservedUnreadBytes;
  UnreadBytes unread({.of_one = 100 * kBytes, .of_all = 100 * kBytes});
  UnreadBytes beside = unread.Beside();
  const std::optional<Message> first = Counted(unread, "a", Frame::OfSize(50 * kBytes));
  REQUIRE(first);
  CHECK(beside.of("a") == 0);
  CHECK(beside.of_all() == 50 * kBytes);
  CHECK_FALSE(Counted(beside, "a", Frame::OfSize(26 * kBytes)));
  CHECK(Counted(beside, "a", Frame::OfSize(25 * kBytes)));
}

TEST_CASE("a counted frame may outlive the counts") {
  std::optional<Message> message;
  {
    UnreadBytes unread;
    message = Counted(unread, "peer", Frame::Copy(std::string(100'000, 'x')));
  }
  REQUIRE(message);
  CHECK(message->payload.size() == 100'000);
}

}  // namespace
}  // namespace b4mrl
