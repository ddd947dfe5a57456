// One connection to one server process: requests out, replies in, whatever happens to the server.
//
// Every request carries an id; its reply is matched by it. Requests stay here until they are
// answered. When the connection was lost and made again, the process behind it may be a replacement
// and whatever the old one held is gone, so all unanswered requests are sent again, unchanged but
// for the deadline. The server executes a numbered step once, however often it arrives; replies
// that come twice are dropped. Thread rule: one thread. The Context outlives the connection.
#pragma once

#include <cstdint>
#include <deque>
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

class Connection {
 public:
  // `token`: the session's, or "". Returns at once; the first request waits for the handshake.
  static Result<Connection> Open(Context& context, const std::string& address, std::string token);

  // Queues a request and returns its id. `request` has its payload and array table set; version,
  // token, id and deadline are filled in here. kLimitExceeded above limits::kMaxRequestsInFlight
  // unanswered ones.
  Result<uint64_t> Send(pb::Request request, Frame payload, Deadline deadline);

  // Waits for the reply to `id`. An error of the server comes back as its Status; kDeadlineExceeded
  // when the request's deadline passed, after which its late reply is dropped.
  Result<ReceivedReply> Receive(uint64_t id);
  // Waits for whichever unanswered request is answered first; its id is in the reply, or in `*id`
  // when the answer was an error. kFailedPrecondition when nothing is in flight.
  Result<ReceivedReply> ReceiveAny(uint64_t* id);
  // Send and Receive in one.
  Result<ReceivedReply> Call(pb::Request request, Frame payload, Deadline deadline);

  // Requests whose outcome the caller has not received yet, answered or not.
  size_t in_flight() const { return pending_.size() + arrived_.size(); }
  // How often the connection was made; above 1 after the server was replaced.
  uint32_t connections() { return socket_.connections(); }

 private:
  struct Pending {
    uint64_t id;
    pb::Request request;
    Frame payload;
    Deadline deadline;
    uint32_t connection;  // the connection it was last sent over
  };
  // What the socket delivered for a pending request, not yet asked for.
  struct Arrived {
    uint64_t id;
    Result<ReceivedReply> reply;
  };

  Connection(DealerSocket socket, std::string token)
      : socket_(std::move(socket)), token_(std::move(token)) {}
  Status Transmit(Pending& pending);
  // Takes messages off the socket until none is left; returns after at most one wait.
  void Pump(const Deadline& deadline);
  void Accept(Message message);
  void ResendAfterReconnection();
  void ExpirePending();
  Deadline NextExpiry() const;

  DealerSocket socket_;
  std::string token_;
  uint64_t next_id_ = 1;
  std::deque<Pending> pending_;
  std::deque<Arrived> arrived_;
};

}  // namespace b4mrl
