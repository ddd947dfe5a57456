// Requests for rows of mapped datasets, which are answered in turns.
//
// A reply is filled for a slice of time as soon as it may begin. Where that does not complete it,
// because the rows are many or have to come from the disk, it goes on for a slice in its turn, so
// that a connection waits for one slice of each other one, not for whole replies. A slice ends
// after a millisecond, or after the row or page of a file during which that millisecond ended.
//
// Of one connection one reply is under way at a time, and the next one begins after it, behind
// those of other connections. Payloads take memory, so few large replies are under way at once, and
// a bounded number of others. Requests that wait are bounded, too: of one connection the second
// oldest makes room, of all connections the newest of the one that has the most.
// Thread rule: one thread.
#pragma once

#include <cstddef>
#include <deque>
#include <functional>
#include <map>

#include "proto/base/clock.h"
#include "proto/base/status.h"
#include "proto/wire/socket.h"
#include "server/batches/batch_reply.h"
#include "server/replies/pending_request.h"

namespace b4mrl {

struct BatchJob {
  PendingRequest pending;
  BatchReply reply;
  Clock::time_point started = {};  // when the filling began
};

class BatchTurns {
 public:
  struct Hooks {
    std::function<void()> alive;               // called every few dozen rows
    std::function<void(BatchJob job)> answer;  // takes a reply that is complete
    // Takes a request without a reply: kDeadlineExceeded, or kLimitExceeded when too many wait.
    std::function<void(const Asker& from, const Status& status)> refuse;
  };
  // `bytes`: what the small replies under way may take, and the large ones as much again; one of
  // each size may be under way whatever it takes.
  BatchTurns(Hooks hooks, size_t bytes);

  // Fills a reply for a slice if it may begin, else it waits. A copy of a request that waits or is
  // under way gives that one the copy's deadline instead.
  void Add(BatchJob job);
  // Lets replies begin that may, and fills the one whose turn it is for a slice.
  void Turn();
  // Refuses the requests whose deadlines have passed.
  void Expire();
  void RefuseAll(const Status& status);
  bool empty() const { return connections_.empty(); }

 private:
  enum Size { kSmall, kLarge };  // of payloads
  struct Connection {
    std::deque<BatchJob> jobs;  // the first one is under way, or waits for a place
    bool is_under_way = false;
  };
  // Replies of one size: how many are under way, and whose first jobs wait for a place.
  struct Places {
    size_t most;
    size_t taken = 0;
    std::deque<RoutingId> waiting = {};
  };

  using Connections = std::map<RoutingId, Connection>;

  static Size SizeOf(const BatchJob& job);
  // Whether the reply is complete after a slice.
  bool Fill(BatchJob* job);
  // Puts a job behind those of its connection.
  void Append(Connection* connection, BatchJob job);
  // Refuses a request if too many wait.
  void MakeRoom();
  // Takes out the first job of a connection, whose next one then waits for a place.
  BatchJob TakeFirst(Connections::iterator connection);
  void Refuse(const BatchJob& job, const Status& status) {
    hooks_.refuse(job.pending.from, status);
  }

  Hooks hooks_;
  Connections connections_;      // those that have jobs
  size_t jobs_ = 0;              // of all connections
  std::deque<RoutingId> turns_;  // connections with a reply under way, next first
  Places places_[2];
};

}  // namespace b4mrl
