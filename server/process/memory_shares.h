// How the daemon's processes divide the memory that `b4mrl serve --memory` allows each of them,
// beyond which the supervisor replaces it: what a process holds for clients must not bring that
// about. What ZeroMQ is still receiving for it has no share (SECURITY.md). All shares are bytes;
// those of a process are the allowed memory at most, and none exceeds what proto/base/limits.h
// says. Functions are pure; any thread.
#pragma once

#include <cstddef>
#include <cstdint>

#include "proto/wire/unread_bytes.h"

namespace b4mrl {

// The simulators' share is the most that they could come to take, beside which what is not listed
// here is small.
struct WorkerShares {
  uint64_t simulators;  // of all sessions
  UnreadLimits unread;  // replies that clients have not read, whatever way they go
  size_t requests;      // requests under way and their replies, other than pictures
  size_t unfinished;    // messages of local doors that have not come entirely
  size_t pictures;      // replies to Renders under way, and the states that they show
};
WorkerShares WorkerSharesOf(uint64_t allowed_bytes);

struct GatewayShares {
  UnreadLimits unread;
  size_t relayed;  // requests that are relayed
};
GatewayShares GatewaySharesOf(uint64_t allowed_bytes);

struct DatasetWorkerShares {
  UnreadLimits unread;
  size_t filled;  // replies with rows that are being filled: small ones, and as much of large ones
};
DatasetWorkerShares DatasetWorkerSharesOf(uint64_t allowed_bytes);

// Whether `more` bytes may be taken beside those `held` of a share. While none are held everything
// fits, else what is larger than a small share could never be taken.
inline bool FitsShare(size_t held, size_t more, size_t share) {
  return held == 0 || held + more <= share;
}

// A share from which several holders take. Thread rule: one thread.
class SharedBytes {
 public:
  explicit SharedBytes(size_t share) : share_(share) {}

  size_t share() const { return share_; }
  size_t held() const { return held_; }
  // Holds `bytes` more, if they fit; else returns false. Give back what was taken.
  bool Take(size_t bytes) {
    if (!FitsShare(held_, bytes, share_)) return false;
    held_ += bytes;
    return true;
  }
  void GiveBack(size_t bytes) { held_ -= bytes; }

 private:
  size_t share_;
  size_t held_ = 0;
};

}  // namespace b4mrl
