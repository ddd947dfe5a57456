// A connection to one process of the daemon, which outlives a replacement of the process.
//
// Every request carries an id, which its reply repeats. The connection keeps a request, payload
// included, until it is answered or its deadline has passed. It sends the request again, with the
// same id and contents and the time that is left,
//   - after a reconnection: the process may be a replacement, which has none of the old one's
//     requests. At the first reconnection, a request gets at least an eighth of its deadline, since
//     the caller may not have read replies for a while;
//   - when no reply to it, or to a request that was sent before it, has come for an eighth of its
//     deadline, the next time for a quarter, then for a half: where a reply takes longer than that
//     to arrive, as a large one on a slow link does, more copies would delay it and those that
//     follow. Replies to later requests do not show that the server has it.
// Where nobody listens on the daemon's machine, the daemon has ended, or was never started
// (proto/wire/listening.h). Requests are then given up after ten seconds, long enough to start the
// daemon again, if their own deadlines are not shorter.
// The daemon executes a numbered step once, however often it arrives. The connection drops replies
// that come twice, or after their request was given up. Thread rule: one thread.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <initializer_list>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "client/link.h"
#include "proto/b4mrl.pb.h"
#include "proto/base/clock.h"
#include "proto/base/status.h"
#include "proto/wire/frame.h"
#include "proto/wire/listening.h"
#include "proto/wire/socket.h"
#include "proto/wire/tensor.h"

namespace b4mrl {

// Memory for the arrays of a request. kInvalidArgument for more than a server accepts, before it is
// taken.
Result<Frame> AllocatePayload(const ArrayLayout& layout);

// The error of a reply that says OK and cannot be understood. Its request was executed, so this is
// kInternal whatever `error` is, which would read as a refusal that has changed nothing.
Status NotUnderstood(const Status& error);

// A reply whose status is OK, with its arrays validated. It owns the memory of `arrays`.
struct ReceivedReply {
  uint64_t request_id = 0;
  pb::Reply envelope;
  Frame payload;
  ArrayReader arrays;

  // ArrayReader::Require, but the error is that of a reply that cannot be understood.
  Result<TensorView> Require(std::string_view name, std::initializer_list<DType> dtypes,
                             std::initializer_list<uint64_t> shape) const;

  // The array `name`, whose elements are of type T and whose shape is `shape`; a view of this
  // reply.
  template <typename T>
  Result<std::span<const T>> Column(std::string_view name,
                                    std::initializer_list<uint64_t> shape) const {
    B4MRL_ASSIGN_OR_RETURN(const TensorView view, Require(name, {DTypeOf<T>()}, shape));
    return view.As<T>();
  }
};

// The outcome of one request.
struct Delivery {
  enum class Kind : uint8_t {
    kReply,     // the request succeeded; `reply` is its reply
    kRefused,   // the server answered with an error, which is the status of `reply`
    kNoAnswer,  // it is unknown whether the request was executed; the status of `reply` says why
  };
  uint64_t id = 0;
  Kind kind = Kind::kNoAnswer;
  Result<ReceivedReply> reply;
};

class Connection {
 public:
  // `token`: the session's token, or "". Returns at once; the first request waits for the
  // handshake. `cancelled`, if given, outlives the connection: once it is true, calls that wait
  // return kUnavailable within 20 ms. Any thread or signal handler may set it.
  static Result<Connection> Open(const Context& context, const std::string& address,
                                 std::string token, const std::atomic<bool>* cancelled = nullptr) {
    return OpenDoor(context, address, "", std::move(token), cancelled);
  }
  // As Open, to a process that also has the local door `door`, if the name is not "". Waits for the
  // door at most limits::kDirectConnectMs; without it, the connection uses `address`.
  static Result<Connection> OpenDoor(const Context& context, const std::string& address,
                                     const std::string& door, std::string token,
                                     const std::atomic<bool>* cancelled);

  // Queues a request and returns its id. The caller has set the payload and the array table of
  // `request`; Send adds version, token, id and deadline. kLimitExceeded while
  // limits::kMaxRequestsInFlight requests are unanswered, or answered but not yet received;
  // kInvalidArgument for a message that is larger than a server accepts, or has a string that is
  // not UTF-8, which no server can read; kFailedPrecondition after CloseSession.
  Result<uint64_t> Send(pb::Request request, Frame payload, Deadline deadline);

  // Waits for the reply to `id`. Returns an error of the server as its Status, kDeadlineExceeded or
  // kUnavailable if no reply came, and kFailedPrecondition if `id` is not in flight.
  Result<ReceivedReply> Receive(uint64_t id);
  // Waits until the first of the requests `ids` is answered, and returns its outcome.
  Delivery ReceiveAny(std::span<const uint64_t> ids);
  // Sends a request and waits for its reply. An interrupted one is dropped.
  Result<ReceivedReply> Call(pb::Request request, Frame payload, Deadline deadline);
  // Drops the request `id` and its reply. The server may execute the request all the same.
  void Abandon(uint64_t id);
  // Drops all requests in flight and closes the token's session, if the token is not "". The
  // default deadline suits callers that ignore the result: a session whose Close got lost ends with
  // its lease. Also works after `cancelled` turned true.
  Status CloseSession(Deadline deadline = Deadline::AfterMs(500));

  // From now on `cancelled` ends a wait only when the server has not replied for so long since then
  // and since the last request.
  void DelayCancellation(Clock::duration grace) { grace_ = grace; }

  // Waits for the first connection; returns whether it was made before the deadline and before the
  // wait was cancelled.
  bool AwaitHandshake(const Deadline& deadline);
  // Whether `cancelled` ends waits now.
  bool IsCancelled();

  // The number of requests that were sent and not received.
  size_t in_flight() const { return pending_.size() + arrived_.size(); }
  // How often the connection was made; more than once if the process was replaced.
  uint32_t connections() { return link_.connections(); }
  // The way that messages go: "door", "ipc", "tcp" or "relay".
  std::string_view transport() const { return is_relay_ ? "relay" : link_.transport(); }
  // Says that the process at the other end passes the requests on.
  void set_is_relay() { is_relay_ = true; }

 private:
  struct Pending {
    uint64_t id;
    pb::Request request;
    Frame payload;
    Deadline deadline;
    Clock::time_point asked;   // when the caller sent the request
    Clock::duration patience;  // an eighth of its first deadline
    Clock::duration interval;  // time without such a reply after which the request is sent again
    uint32_t connection;       // number, from 1, of the connection that last sent the request
    Clock::time_point sent;    // when the request was last sent
    Clock::time_point heard;   // when a reply came to a request that was sent before this one
    bool resent = false;       // whether the request was sent more than once
    bool renewed = false;      // whether its deadline was extended after a reconnection
  };

  Connection(Link link, Listening listening, std::string token, const std::atomic<bool>* cancelled)
      : link_(std::move(link)),
        listening_(std::move(listening)),
        token_(std::move(token)),
        cancelled_(cancelled) {}
  Status Transmit(Pending& pending);
  // Waits for one message and accepts it. Resends and gives up requests that are due.
  void Pump();
  // Keeps a message as the reply to its request; false if it answers no pending request.
  bool Accept(Message message);
  // Notes that a reply to request `id`, its first or another one, has come.
  void NoteReply(uint64_t id);
  void Resend();
  void ExpirePending();
  Clock::time_point ResendTime(const Pending& pending) const;
  // The time at which a request is given up: its deadline, or earlier if the daemon has ended.
  Clock::time_point EndOf(const Pending& pending) const;
  Status NoAnswer();
  // The time at which the first pending request is sent again or given up.
  Deadline NextWake() const;

  Link link_;
  Listening listening_;
  bool is_relay_ = false;
  bool is_closed_ = false;  // CloseSession was called
  std::string token_;
  const std::atomic<bool>* cancelled_;
  Clock::duration grace_{0};
  std::optional<Clock::time_point> cancelled_since_;
  uint64_t next_id_ = 1;
  uint32_t connections_seen_ = 0;
  Clock::time_point last_reply_{};
  Clock::time_point looked_{};  // when Resend was last called
  std::deque<Pending> pending_;
  std::deque<Delivery> arrived_;
};

}  // namespace b4mrl
