// Requests for rows of mapped datasets: those whose replies are under way, and those that wait.
//
// A reply is filled for a slice of time at once. Where that does not complete it, because the
// rows are many or have to come from the disk, it goes on for a slice in its turn, so that no other
// connection waits for more than a slice of each. Of one connection one reply is under way at a
// time; large replies under way are few, since their payloads take memory. Requests that may not
// begin yet wait, but not many of them.
// Thread rule: one thread.
#pragma once

#include <cstddef>
#include <deque>
#include <functional>
#include <optional>
#include <utility>
#include <vector>

#include "proto/base/clock.h"
#include "proto/base/status.h"
#include "proto/wire/socket.h"
#include "server/batches/batch_reply.h"
#include "server/replies/pending_request.h"

namespace b4mrl {

// A reply that is being filled.
struct BatchJob {
  PendingRequest pending;
  Clock::time_point started;
  BatchReply reply;
  bool complete = false;
};

class BatchTurns {
 public:
  // `alive` is called every few dozen rows.
  explicit BatchTurns(std::function<void()> alive) : alive_(std::move(alive)) {}

  // Whether a reply with that payload to a connection may begin.
  bool MayBegin(const RoutingId& peer, size_t payload_bytes) const;
  // Fills a reply for a slice. Returns it if it is complete, else it is under way.
  std::optional<BatchJob> Begin(BatchJob job);
  // Fills the reply under way whose turn it is. Returns it if it is complete by then, or if its
  // deadline passed.
  std::optional<BatchJob> Next();

  // Keeps a request until its reply may begin, of which the payload takes so many bytes as far as
  // is known. A copy of one that waits or is under way gives that one the copy's deadline.
  // kLimitExceeded when too many wait.
  Status Wait(PendingRequest pending, size_t payload_bytes);
  // Of the requests whose replies may begin, or whose deadlines have passed, the one that has
  // waited longest.
  std::optional<PendingRequest> TakeWaiting();

  bool empty() const { return jobs_.empty() && waiting_.empty(); }
  // Hands out all requests, none of which is answered then.
  std::vector<PendingRequest> TakeAll();

 private:
  struct Waiting {
    PendingRequest pending;
    size_t payload_bytes;
  };

  PendingRequest* FindOriginal(PendingRequest* copy);

  std::function<void()> alive_;
  std::deque<BatchJob> jobs_;  // the next one first
  std::deque<Waiting> waiting_;
};

}  // namespace b4mrl
