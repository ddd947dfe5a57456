// One connection to one server process: requests out, replies in, whatever happens to the server.
//
// Every request carries an id; its reply is matched by it. A request stays here, payload included,
// until it is answered. It is sent again, unchanged but for the deadline,
//   - after a reconnection: the process behind it may be a replacement, and what the old one held
//     is gone. Once, it then has an eighth of its deadline again, for the caller may have been busy
//     elsewhere all the while;
//   - when an eighth of its deadline has passed without any reply to anything.
// The server executes a numbered step once, however often it arrives; replies that come twice, or
// after their request was given up, are dropped. Thread rule: one thread. The Context outlives the
// connection.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <span>
#include <string>
#include <vector>

#include "proto/b4mrl.pb.h"
#include "proto/base/clock.h"
#include "proto/base/status.h"
#include "proto/wire/frame.h"
#include "proto/wire/socket.h"

namespace b4mrl {

// A reply whose status is OK, with its arrays validated. The views in `arrays` live as long as it
// does.
struct ReceivedReply {
  uint64_t request_id = 0;
  pb::Reply envelope;
  Frame payload;
  ArrayReader arrays;
};

// What became of one request.
struct Delivery {
  enum class Kind : uint8_t {
    kReply,     // done: `reply` has it
    kRefused,   // the server answered with an error, which `reply` carries
    kNoAnswer,  // none that settles whether it was executed: `reply` says why
  };
  uint64_t id = 0;
  Kind kind = Kind::kNoAnswer;
  Result<ReceivedReply> reply;
};

class Connection {
 public:
  // `token`: the session's, or "". Returns at once; the first request waits for the handshake.
  // `cancelled`, if given, outlives the connection: once it is true, whoever waits here gets
  // kUnavailable within 20 ms. Any thread or signal handler may set it.
  static Result<Connection> Open(Context& context, const std::string& address, std::string token,
                                 const std::atomic<bool>* cancelled = nullptr);

  // Queues a request and returns its id. `request` has its payload and array table set; version,
  // token, id and deadline are filled in here. kLimitExceeded while limits::kMaxRequestsInFlight
  // requests are unanswered or answered but not yet received.
  Result<uint64_t> Send(pb::Request request, Frame payload, Deadline deadline);

  // Waits for the reply to `id`. An error of the server comes back as its Status;
  // kDeadlineExceeded or kUnavailable when none came; kFailedPrecondition when `id` is not in
  // flight.
  Result<ReceivedReply> Receive(uint64_t id);
  // Waits for whichever of `ids` is answered first.
  Delivery ReceiveAny(std::span<const uint64_t> ids);
  // Send and Receive in one.
  Result<ReceivedReply> Call(pb::Request request, Frame payload, Deadline deadline);
  // The reply to `id` is not wanted any more. The server may execute the request all the same.
  void Abandon(uint64_t id);
  // Abandons everything in flight and gives the token's session back, if there is one. Where nobody
  // asks how it went, half a second is enough: the lease settles the rest. It is done even after
  // `cancelled`.
  Status CloseSession(Deadline deadline = Deadline::AfterMs(500));

  // Waits until the connection is made for the first time; false if it is not by then.
  bool AwaitHandshake(const Deadline& deadline);

  // Requests that were sent and not received.
  size_t in_flight() const { return pending_.size() + arrived_.size(); }
  // How often the connection was made; above 1 after the server was replaced.
  uint32_t connections() { return socket_.connections(); }

 private:
  struct Pending {
    uint64_t id;
    pb::Request request;
    Frame payload;
    Deadline deadline;
    Clock::duration patience;  // silence after which it is sent again
    uint32_t connection;       // the connection it was last sent over
    Clock::time_point sent;
    bool resent = false;
    bool renewed = false;  // its deadline, after a reconnection
  };

  Connection(DealerSocket socket, std::string token, const std::atomic<bool>* cancelled)
      : socket_(std::move(socket)), token_(std::move(token)), cancelled_(cancelled) {}
  bool IsCancelled() const { return cancelled_ != nullptr && *cancelled_; }
  Status Transmit(Pending& pending);
  // Takes one message off the socket, or waits for one and for what is due meanwhile.
  void Pump();
  // False for what answers no pending request.
  bool Accept(Message message);
  void Resend();
  void ExpirePending();
  Clock::time_point ResendTime(const Pending& pending) const;
  // When the first pending request is to be sent again or given up.
  Deadline NextWake() const;

  DealerSocket socket_;
  std::string token_;
  const std::atomic<bool>* cancelled_;
  uint64_t next_id_ = 1;
  uint32_t connections_seen_ = 0;
  Clock::time_point last_reply_{};
  std::deque<Pending> pending_;
  std::deque<Delivery> arrived_;
};

}  // namespace b4mrl
