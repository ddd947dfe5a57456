#include "client/connection.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <utility>

#include "proto/base/limits.h"

namespace b4mrl {

Result<Connection> Connection::Open(Context& context, const std::string& address,
                                    std::string token) {
  B4MRL_ASSIGN_OR_RETURN(DealerSocket socket, DealerSocket::Connect(context, address));
  return Connection(std::move(socket), std::move(token));
}

Result<uint64_t> Connection::Send(pb::Request request, Frame payload, Deadline deadline) {
  if (pending_.size() >= limits::kMaxRequestsInFlight) {
    return Status(StatusCode::kLimitExceeded,
                  fmt::format("{} requests are in flight, at most {}", pending_.size() + 1,
                              limits::kMaxRequestsInFlight));
  }
  request.set_protocol_version(limits::kProtocolVersion);
  request.set_session_token(token_);
  request.set_request_id(next_id_);
  pending_.push_back({next_id_, std::move(request), std::move(payload), deadline, 0});
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
  // Before the first handshake the message waits in the queue of connection 1 and is not lost.
  pending.connection = std::max(socket_.connections(), 1u);
  B4MRL_ASSIGN_OR_RETURN(Frame envelope, SerializeEnvelope(pending.request));
  return socket_.Send({std::move(envelope), pending.payload.Share()});
}

Result<ReceivedReply> Connection::Receive(uint64_t id) {
  while (true) {
    for (auto it = arrived_.begin(); it != arrived_.end(); ++it) {
      if (it->id != id) continue;
      Result<ReceivedReply> reply = std::move(it->reply);
      arrived_.erase(it);
      return reply;
    }
    const bool waiting = std::any_of(pending_.begin(), pending_.end(),
                                     [id](const Pending& pending) { return pending.id == id; });
    if (!waiting) {
      return Status(StatusCode::kFailedPrecondition,
                    fmt::format("request {} is not in flight", id));
    }
    Pump(NextExpiry());
  }
}

Result<ReceivedReply> Connection::ReceiveAny(uint64_t* id) {
  while (arrived_.empty()) {
    if (pending_.empty()) {
      return Status(StatusCode::kFailedPrecondition, "no request is in flight");
    }
    Pump(NextExpiry());
  }
  *id = arrived_.front().id;
  Result<ReceivedReply> reply = std::move(arrived_.front().reply);
  arrived_.pop_front();
  return reply;
}

Result<ReceivedReply> Connection::Call(pb::Request request, Frame payload, Deadline deadline) {
  B4MRL_ASSIGN_OR_RETURN(const uint64_t id, Send(std::move(request), std::move(payload), deadline));
  return Receive(id);
}

Deadline Connection::NextExpiry() const {
  const auto first = std::min_element(
      pending_.begin(), pending_.end(),
      [](const Pending& a, const Pending& b) { return a.deadline.at() < b.deadline.at(); });
  return first->deadline;
}

void Connection::Pump(const Deadline& deadline) {
  std::optional<Message> message = socket_.TryReceive();
  if (!message) {
    socket_.Wait(deadline);
    ResendAfterReconnection();
    message = socket_.TryReceive();
  }
  for (; message; message = socket_.TryReceive()) Accept(std::move(*message));
  ExpirePending();
}

void Connection::Accept(Message message) {
  ReceivedReply reply;
  if (!ParseEnvelope(message.envelope, &reply.envelope).ok()) return;
  reply.request_id = reply.envelope.request_id();
  const auto pending = std::find_if(pending_.begin(), pending_.end(), [&](const Pending& entry) {
    return entry.id == reply.request_id;
  });
  if (pending == pending_.end()) return;  // answered already, or given up
  pending_.erase(pending);
  const uint64_t id = reply.request_id;
  if (Status status = GetStatus(reply.envelope.status()); !status.ok()) {
    arrived_.push_back({id, std::move(status)});
    return;
  }
  reply.payload = std::move(message.payload);
  Result<ArrayReader> arrays = ArrayReader::Parse(reply.envelope.arrays(), reply.payload);
  if (!arrays.ok()) {
    arrived_.push_back({id, arrays.status().WithContext("reply")});
    return;
  }
  reply.arrays = std::move(*arrays);
  arrived_.push_back({id, std::move(reply)});
}

void Connection::ResendAfterReconnection() {
  const uint32_t connection = std::max(socket_.connections(), 1u);
  for (Pending& pending : pending_) {
    // A full queue is no loss here: the next reconnection or the deadline settles it.
    if (pending.connection < connection) (void)Transmit(pending);
  }
}

void Connection::ExpirePending() {
  for (auto it = pending_.begin(); it != pending_.end();) {
    if (!it->deadline.expired()) {
      ++it;
      continue;
    }
    const bool connected = socket_.connections() > 0;
    arrived_.push_back(
        {it->id, connected ? Status(StatusCode::kDeadlineExceeded, "no answer within the deadline")
                           : Status(StatusCode::kUnavailable, "the server cannot be reached")});
    it = pending_.erase(it);
  }
}

}  // namespace b4mrl
