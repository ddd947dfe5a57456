#include "client/connection.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <utility>

#include "proto/base/limits.h"

namespace b4mrl {
namespace {

constexpr int kPatienceFraction = 8;
constexpr int64_t kLookMs = 20;               // between two looks at `cancelled`
constexpr std::chrono::seconds kQuiet{1};     // before anything looks for the daemon's end
constexpr std::chrono::seconds kRestart{10};  // for a daemon that has ended to be started again

Delivery Read(uint64_t id, pb::Reply envelope, Frame payload) {
  if (Status status = GetStatus(envelope.status()); !status.ok()) {
    return {id, Delivery::Kind::kRefused, std::move(status)};
  }
  ReceivedReply reply;
  reply.request_id = id;
  reply.envelope = std::move(envelope);
  reply.payload = std::move(payload);
  Result<ArrayReader> arrays = ArrayReader::Parse(reply.envelope.arrays(), reply.payload);
  if (!arrays.ok()) {
    return {id, Delivery::Kind::kNoAnswer, NotUnderstood(arrays.status())};
  }
  reply.arrays = std::move(*arrays);
  return {id, Delivery::Kind::kReply, std::move(reply)};
}

// A daemon would end the connection each time that a longer payload is sent.
Status CheckPayloadBytes(uint64_t bytes) {
  if (bytes <= limits::kMaxPayloadBytes) return Status();
  return InvalidNumber("bytes of the arrays", static_cast<double>(bytes),
                       fmt::format("at most {}", limits::kMaxPayloadBytes));
}

// Protocol Buffers writes strings that are not UTF-8, but reads none. The strings of the frequent
// requests are the client's own, so these are not read for it.
Status CheckStrings(const pb::Request& request) {
  if (request.has_step() || request.has_query() || request.has_sample()) return Status();
  if (pb::Request().ParseFromString(request.SerializeAsString())) return Status();
  return Status(
      StatusCode::kInvalidArgument,
      "a name, an argument or another string of the request is not UTF-8, allowed: UTF-8");
}

}  // namespace

Result<Frame> AllocatePayload(const ArrayLayout& layout) {
  B4MRL_RETURN_IF_ERROR(CheckPayloadBytes(layout.payload_bytes()));
  return layout.Allocate();
}

Status NotUnderstood(const Status& error) {
  return Status(StatusCode::kInternal, fmt::format("unreadable reply: {}", error.message()));
}

Result<TensorView> ReceivedReply::Require(std::string_view name,
                                          std::initializer_list<DType> dtypes,
                                          std::initializer_list<uint64_t> shape) const {
  Result<TensorView> view = arrays.Require(name, dtypes, shape);
  if (!view.ok()) return NotUnderstood(view.status());
  return view;
}

Result<Connection> Connection::OpenDoor(const Context& context, const std::string& address,
                                        const std::string& door, std::string token,
                                        const std::atomic<bool>* cancelled) {
  B4MRL_ASSIGN_OR_RETURN(
      Link link,
      Link::Open(context, address, door, Deadline::AfterMs(limits::kDirectConnectMs), cancelled));
  Listening listening(address, link.transport() == "door" ? door : "");
  return Connection(std::move(link), std::move(listening), std::move(token), cancelled);
}

bool Connection::IsCancelled() {
  if (cancelled_ == nullptr || !*cancelled_) return false;
  const Clock::time_point now = Clock::now();
  if (!cancelled_since_) cancelled_since_ = now;
  Clock::time_point since = std::max(*cancelled_since_, last_reply_);
  if (!pending_.empty()) since = std::max(since, pending_.back().asked);
  return now - since >= grace_;
}

bool Connection::AwaitHandshake(const Deadline& deadline) {
  while (link_.connections() == 0) {
    if (deadline.expired() || IsCancelled()) return false;
    link_.Wait(Deadline::AfterMs(std::min(deadline.remaining_ms(), kLookMs)));
  }
  return true;
}

Result<uint64_t> Connection::Send(pb::Request request, Frame payload, Deadline deadline) {
  if (is_closed_) return Status(StatusCode::kFailedPrecondition, "the session was closed");
  if (in_flight() >= limits::kMaxRequestsInFlight) {
    return Status(StatusCode::kLimitExceeded,
                  fmt::format("{} requests in flight, at most {}", in_flight() + 1,
                              limits::kMaxRequestsInFlight));
  }
  B4MRL_RETURN_IF_ERROR(CheckPayloadBytes(payload.size()));
  B4MRL_RETURN_IF_ERROR(CheckStrings(request));
  request.set_protocol_version(limits::kProtocolVersion);
  request.set_session_token(token_);
  request.set_request_id(next_id_);
  const Clock::time_point now = Clock::now();
  const Clock::duration patience = (deadline.at() - now) / kPatienceFraction;
  pending_.push_back({next_id_, std::move(request), std::move(payload), deadline, now, patience,
                      patience, 0, now, now});
  if (Status status = Transmit(pending_.back()); !status.ok()) {
    pending_.pop_back();
    return status;
  }
  return next_id_++;
}

Status Connection::Transmit(Pending& pending) {
  const int64_t remaining =
      std::clamp<int64_t>(pending.deadline.remaining_ms(), 1, limits::kMaxDeadlineMs);
  pending.request.set_deadline_ms(static_cast<uint32_t>(remaining));
  // connections_seen_ may be out of date, which costs a needless copy; asking costs a system call.
  // A message that is sent before the first handshake goes over connection 1.
  pending.connection = std::max(connections_seen_, 1u);
  pending.sent = Clock::now();
  B4MRL_ASSIGN_OR_RETURN(Frame envelope, SerializeEnvelope(pending.request));
  return link_.Send({std::move(envelope), pending.payload.Share()});
}

Result<ReceivedReply> Connection::Receive(uint64_t id) {
  return std::move(ReceiveAny(std::span(&id, 1)).reply);
}

Delivery Connection::ReceiveAny(std::span<const uint64_t> ids) {
  const auto wanted = [ids](const auto& entry) {
    return std::find(ids.begin(), ids.end(), entry.id) != ids.end();
  };
  while (true) {
    const auto arrived = std::find_if(arrived_.begin(), arrived_.end(), wanted);
    if (arrived != arrived_.end()) {
      Delivery delivery = std::move(*arrived);
      arrived_.erase(arrived);
      return delivery;
    }
    if (std::none_of(pending_.begin(), pending_.end(), wanted)) {
      return {0, Delivery::Kind::kNoAnswer,
              Status(StatusCode::kFailedPrecondition, "no such request is in flight")};
    }
    if (IsCancelled()) {
      return {ids.front(), Delivery::Kind::kNoAnswer,
              Status(StatusCode::kUnavailable, "interrupted")};
    }
    Pump();
  }
}

Result<ReceivedReply> Connection::Call(pb::Request request, Frame payload, Deadline deadline) {
  B4MRL_ASSIGN_OR_RETURN(const uint64_t id, Send(std::move(request), std::move(payload), deadline));
  Result<ReceivedReply> reply = Receive(id);
  if (!reply.ok()) Abandon(id);
  return reply;
}

void Connection::Abandon(uint64_t id) {
  const auto is_it = [id](const auto& entry) { return entry.id == id; };
  std::erase_if(pending_, is_it);
  std::erase_if(arrived_, is_it);
}

Status Connection::CloseSession(Deadline deadline) {
  // Makes room for one more, if as many as allowed are in flight.
  pending_.clear();
  arrived_.clear();
  // Even after `cancelled`: otherwise the session would stay until its lease runs out.
  cancelled_ = nullptr;
  is_closed_ = false;  // so that a Close whose reply got lost may be tried again
  pb::Request request;
  request.mutable_close();
  const Status status = Call(std::move(request), Frame(), deadline).status();
  is_closed_ = true;
  return status;
}

Clock::time_point Connection::EndOf(const Pending& pending) const {
  const Clock::time_point gone_since = listening_.gone_since();
  if (gone_since == Clock::time_point::max()) return pending.deadline.at();
  return std::min(pending.deadline.at(), std::max(gone_since, pending.asked) + kRestart);
}

Status Connection::NoAnswer() {
  const std::string& address = listening_.address();
  if (listening_.gone_since() != Clock::time_point::max()) {
    return Status(StatusCode::kUnavailable,
                  fmt::format("nobody listens at {}{}", address,
                              link_.connections() > 0 ? " any more; has the daemon ended?" : ""));
  }
  if (link_.connections() > 0) {
    return Status(StatusCode::kDeadlineExceeded,
                  fmt::format("no answer from {} within the deadline", address));
  }
  return Status(StatusCode::kUnavailable, fmt::format("{} cannot be reached", address));
}

Clock::time_point Connection::ResendTime(const Pending& pending) const {
  return std::max(pending.sent, pending.heard) + pending.interval;
}

Deadline Connection::NextWake() const {
  Clock::time_point first = Clock::time_point::max();
  for (const Pending& pending : pending_) {
    first = std::min(first, EndOf(pending));
    // Until the first connection is there, nothing is sent again.
    if (connections_seen_ > 0) first = std::min(first, ResendTime(pending));
  }
  return Deadline::After(std::chrono::ceil<std::chrono::milliseconds>(first - Clock::now()));
}

void Connection::Pump() {
  std::optional<Message> message = link_.Receive(NextWake());
  const bool is_answer = message && Accept(std::move(*message));
  // Where messages keep coming, no wait is empty.
  const Clock::time_point now = is_answer ? last_reply_ : Clock::now();
  if (!message || now - looked_ >= std::chrono::milliseconds(kLookMs)) Resend();
  // No request expires while the queue may still hold its reply: only when the queue is empty, or
  // held a message that answers no request.
  if (!is_answer) ExpirePending();
}

bool Connection::Accept(Message message) {
  pb::Reply envelope;
  if (!ParseEnvelope(message.envelope, &envelope).ok()) return false;
  uint64_t id = envelope.request_id();
  // A request that cannot be read, for a name that is not UTF-8, is refused without its id.
  if (id == 0 && envelope.status().code() != 0 && pending_.size() == 1) id = pending_.front().id;
  const auto pending = std::find_if(pending_.begin(), pending_.end(),
                                    [id](const Pending& entry) { return entry.id == id; });
  NoteReply(id);
  if (pending == pending_.end()) return false;  // answered already, or given up
  Delivery delivery = Read(id, std::move(envelope), std::move(message.payload));
  // The server refused one copy of the request; another copy may still be executed.
  const bool passing = delivery.kind == Delivery::Kind::kRefused &&
                       delivery.reply.status().recoverable() && pending->resent;
  if (passing) delivery.kind = Delivery::Kind::kNoAnswer;
  pending_.erase(pending);
  arrived_.push_back(std::move(delivery));
  return true;
}

void Connection::NoteReply(uint64_t id) {
  if (id == 0) return;  // to a request that nobody has sent
  last_reply_ = Clock::now();
  for (Pending& other : pending_) {
    if (other.id > id) other.heard = last_reply_;
  }
}

void Connection::Resend() {
  connections_seen_ = link_.connections();
  const Clock::time_point now = looked_ = Clock::now();
  const bool is_quiet = std::ranges::any_of(
      pending_, [now](const Pending& pending) { return pending.asked + kQuiet < now; });
  if (is_quiet) listening_.Look(now);
  if (connections_seen_ == 0) return;  // all of it is still queued for the first one
  for (Pending& pending : pending_) {
    const bool is_reconnected = pending.connection < connections_seen_;
    if (!is_reconnected && ResendTime(pending) > now) continue;
    if (is_reconnected && !pending.renewed) {
      pending.renewed = true;
      const Deadline renewed =
          Deadline::After(std::chrono::ceil<std::chrono::milliseconds>(pending.patience));
      if (renewed.at() > pending.deadline.at()) pending.deadline = renewed;
    }
    if (!is_reconnected) pending.interval *= 2;
    pending.resent = true;
    // With a full queue, the request is sent again later, or given up at its deadline.
    (void)Transmit(pending);
  }
}

void Connection::ExpirePending() {
  const Clock::time_point now = Clock::now();
  for (auto it = pending_.begin(); it != pending_.end();) {
    if (EndOf(*it) > now) {
      ++it;
      continue;
    }
    arrived_.push_back({it->id, Delivery::Kind::kNoAnswer, NoAnswer()});
    it = pending_.erase(it);
  }
}

}  // namespace b4mrl
