#include "proto/wire/unread_bytes.h"

#include <catch2/catch.hpp>
#include <string>
#include <utility>
#include <vector>

#include "proto/base/limits.h"

namespace b4mrl {
namespace {

// As many frames as are let through, each a share of `payload`, so that they need no memory.
std::vector<Frame> CountUntilRefused(UnreadBytes& unread, const std::string& receiver,
                                     Frame& payload) {
  std::vector<Frame> counted;
  while (true) {
    Result<Frame> frame = unread.Count(receiver, payload.Share());
    if (!frame.ok()) {
      CHECK(frame.status().code() == StatusCode::kLimitExceeded);
      return counted;
    }
    counted.push_back(std::move(*frame));
  }
}

TEST_CASE("a counted frame has the bytes of its payload until it is destroyed") {
  UnreadBytes unread;
  for (const size_t size : {size_t{5}, limits::kCountedFrameBytes}) {  // ZeroMQ stores both kinds
    const std::string text(size, 'x');
    {
      const Result<Frame> frame = unread.Count("peer", Frame::Copy(text));
      REQUIRE(frame.ok());
      CHECK(frame->view() == text);
      CHECK(unread.of("peer") == size);
      CHECK(unread.of_all() == size);
    }
    CHECK(unread.of("peer") == 0);
    CHECK(unread.of_all() == 0);
  }
}

TEST_CASE("a peer is refused more unread bytes than the limit until it has read some") {
  UnreadBytes unread;
  Frame payload = Frame::OfSize(limits::kMaxPayloadBytes);
  std::vector<Frame> counted = CountUntilRefused(unread, "slow", payload);
  CHECK(unread.of("slow") == limits::kMaxUnreadBytes);
  CHECK(unread.Count("other", payload.Share()).ok());
  counted.pop_back();
  CHECK(unread.Count("slow", payload.Share()).ok());
}

TEST_CASE("peers together are refused more unread bytes than their limit") {
  UnreadBytes unread;
  Frame payload = Frame::OfSize(limits::kMaxPayloadBytes);
  std::vector<std::vector<Frame>> counted;
  for (int peer = 0; unread.of_all() < limits::kMaxUnreadBytesOfAll; ++peer) {
    counted.push_back(CountUntilRefused(unread, std::to_string(peer), payload));
    REQUIRE_FALSE(counted.back().empty());
  }
  CHECK(unread.of_all() == limits::kMaxUnreadBytesOfAll);
  CHECK_FALSE(unread.Count("late", payload.Share()).ok());
  counted.clear();
  CHECK(unread.of_all() == 0);
  CHECK(unread.Count("late", payload.Share()).ok());
}

TEST_CASE("a counted frame may outlive the counts") {
  Frame frame;
  {
    UnreadBytes unread;
    frame = std::move(*unread.Count("peer", Frame::Copy(std::string(100'000, 'x'))));
  }
  CHECK(frame.size() == 100'000);
}

}  // namespace
}  // namespace b4mrl
