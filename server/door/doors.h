// The local doors of an environment worker: all of its clients that share memory with it. They
// stand beside the worker's RouterSocket and speak the same messages.
//
// A client's bytes reach the worker without a system call. The doors' sockets carry bells and ends
// of connections alone; epoll_fd() is readable when there are some, or a new client.
//
// Clients that break the ring's rules, ring without reason or go beyond a limit are dropped: they
// connect again, or use ZeroMQ. Clients of other users are refused. What a client sent before its
// end is received like everything else, and only then its door is let go.
//
// Thread rule: the worker's socket thread.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "proto/base/limits.h"
#include "proto/base/status.h"
#include "proto/base/unique_fd.h"
#include "proto/wire/socket.h"
#include "proto/wire/unread_bytes.h"
#include "server/door/door.h"

namespace b4mrl {

class Doors {
 public:
  // `listener`: the listening socket, inherited from the supervisor; -1: the worker has no doors.
  // `spin_us`: the longest spin that clients are told. `unread`: counts the replies that clients
  // have not read. `unfinished_bytes`: what messages that have not come entirely may take.
  Doors(int listener, uint32_t spin_us, UnreadBytes unread = UnreadBytes(),
        size_t unfinished_bytes = limits::kMaxQueuedBytes);

  // Whether a client is connected.
  bool any() const { return !doors_.empty(); }
  // -1 if the worker has no doors.
  int epoll_fd() const { return epoll_.get(); }
  // Accepts new clients, reads bells and lets go of clients that have gone, once everything that
  // they sent was received. To be called after each sleep, and about once a millisecond.
  void Attend();

  // The next message, the clients having their turns. Its sender is the number of the client's
  // door, as 8 bytes. Nothing, too, after bytes were taken of a message that has not come entirely:
  // a call copies one ring's content at most, and HasWork says whether to go on. Also publishes
  // what waits of replies that are longer than the rings.
  std::optional<IncomingMessage> TryReceive();
  // Never blocks. kUnavailable: the client has gone; kLimitExceeded: the client does not read its
  // replies.
  Status Send(const RoutingId& receiver, Message message);

  // Whether a client has sent something, or has made space for a reply that waits. To be called
  // again and again while the worker spins.
  bool HasWork() const;
  // Between BeginSleep and EndSleep the caller may wait for epoll_fd(). BeginSleep returns false
  // when there is work already.
  bool BeginSleep();
  void EndSleep();
  // Publishes the replies that wait, for at most `longest_ms`.
  void Drain(int64_t longest_ms);

 private:
  void Accept();
  void Greet(UniqueFd socket);
  // The door of `number`; null when its client has gone.
  Door* Find(uint64_t number) const;
  bool AnyQueued() const;
  // Publishes what there is space for of the replies that wait.
  void Write();
  // Whether messages that have not come entirely may take more than they are to; a single one never
  // does.
  bool HasTooManyUnfinished() const;
  // Lets go of the clients from whom nothing has come for longest, since they may never go on,
  // until the others' messages take no more.
  void BoundUnfinished();

  int listener_;
  uint32_t spin_us_;
  size_t most_unfinished_bytes_;
  UniqueFd epoll_;
  std::vector<std::unique_ptr<Door>> doors_;  // by number, ascending
  size_t next_ = 0;                           // the door whose turn it is
  uint64_t last_number_ = 0;
  UnreadBytes unread_;
};

}  // namespace b4mrl
