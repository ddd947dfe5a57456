#include "server/gateway/relay.h"

#include <fmt/format.h>

#include <utility>

#include "proto/base/limits.h"
#include "server/process/memory_shares.h"
#include "server/replies/pending_request.h"
#include "server/replies/reply.h"
#include "server/replies/request_kinds.h"

namespace b4mrl {
namespace {

// Limit on the replies that are taken from one route before the next route has its turn.
constexpr int kReplyBurst = 64;
constexpr auto kSweepInterval = std::chrono::milliseconds(100);
// Time in which a reply may still come: after its request's deadline, from a replaced process; or
// after its session's end.
constexpr int64_t kGraceMs = 5'000;

bool IsForDatasets(const pb::Request& request) {
  const RequestKind* kind = FindRow(kRequestKinds, request.payload_case());
  return kind != nullptr && kind->server == Server::kDatasetWorker;
}

// The first letter of a route's key: a client chooses its routing id, and could choose a token.
constexpr char kOfSession = 's';
constexpr char kOfClient = 'c';

size_t BytesOf(const Message& message) { return message.envelope.size() + message.payload.size(); }

Message Copy(Message& message) { return {message.envelope.Share(), message.payload.Share()}; }

}  // namespace

Relay::Relay(Context& sockets, SharedState& shared, Addresses addresses, SendFunction send,
             Limits limits)
    : sockets_(sockets),
      shared_(shared),
      table_(shared),
      addresses_(std::move(addresses.workers)),
      send_(std::move(send)),
      limits_(limits) {
  addresses_.push_back(std::move(addresses.dataset_worker));
}

Status Relay::Forward(const RoutingId& client, const pb::Request& request, Message message) {
  B4MRL_ASSIGN_OR_RETURN(Route * route, FindOrMakeRoute(client, request));
  const auto found = route->carried.find(request.request_id());
  if (found != route->carried.end()) {
    return ForwardCopy(*route, found->second, client, request, std::move(message));
  }
  const size_t bytes = BytesOf(message);
  B4MRL_RETURN_IF_ERROR(Admit(*route, bytes));
  if (!route->socket.Send(Copy(message)).ok()) {
    return Status(
        StatusCode::kLimitExceeded,
        fmt::format("the relay's queue towards this process holds {} messages, at most {}",
                    limits::kHighWaterMark, limits::kHighWaterMark));
  }
  route->last_use = Clock::now();
  route->last_client = client;
  route->bytes += bytes;
  bytes_ += bytes;
  route->carried.emplace(
      request.request_id(),
      Carried{client, std::move(message), DeadlineOf(request, kGraceMs), bytes, false});
  ++in_flight_;
  return Status();
}

Status Relay::ForwardCopy(Route& route, Carried& carried, const RoutingId& client,
                          const pb::Request& request, Message message) {
  if (!IsCopy(carried.message, request, message)) {
    return OtherContents(request.request_id());
  }
  // A client that has reconnected is another one here, and the process answers once.
  carried.client = client;
  carried.deadline = DeadlineOf(request, kGraceMs);
  route.last_use = Clock::now();
  route.last_client = client;
  const size_t bytes = BytesOf(message);
  if (!HasRoomForCopy(route, bytes) || !route.socket.Send(Copy(message)).ok()) return Status();
  route.bytes += bytes;
  bytes_ += bytes;
  carried.message = std::move(message);
  carried.bytes += bytes;
  return Status();
}

bool Relay::IsCopy(const Message& earlier, const pb::Request& request, const Message& message) {
  request_.Clear();
  if (!ParseEnvelope(earlier.envelope, &request_).ok()) return false;
  pb::Request latest = request;
  return HashOfContents(&request_) == HashOfContents(&latest) &&
         earlier.payload.view() == message.payload.view();
}

bool Relay::HoldsSession(const Route& route) const {
  return table_.Holds(route.session, route.token) &&
         shared_.session(route.session).worker == route.process;
}

Result<Relay::Route*> Relay::FindOrMakeRoute(const RoutingId& client, const pb::Request& request) {
  const uint32_t dataset_worker = static_cast<uint32_t>(addresses_.size()) - 1;
  if (IsForDatasets(request)) {
    const auto found = routes_.find(kOfClient + client);
    if (found != routes_.end()) return &found->second;
    return MakeRoute(kOfClient + client, dataset_worker, limits::kMaxSessions, "");
  }
  const std::string& token = request.session_token();
  const std::string key = kOfSession + token;
  const auto found = routes_.find(key);
  if (found != routes_.end() && HoldsSession(found->second)) return &found->second;
  const std::optional<uint32_t> session = table_.Find(token);
  if (!session) {
    return Status(StatusCode::kSessionLost, "no such session: it was closed or its lease ran out");
  }
  const uint32_t worker = shared_.session(*session).worker;
  if (worker >= dataset_worker) {
    return Status(StatusCode::kSessionLost, "the session's record is damaged");
  }
  if (found != routes_.end()) Drop(found);  // the route to an earlier session of this token
  return MakeRoute(key, worker, *session, token);
}

Result<Relay::Route*> Relay::MakeRoute(const std::string& key, uint32_t process, uint32_t session,
                                       const std::string& token) {
  B4MRL_RETURN_IF_ERROR(EvictIdleRoute());
  B4MRL_ASSIGN_OR_RETURN(DealerSocket socket, DealerSocket::Connect(sockets_, addresses_[process]));
  Route route{process, session, token, std::move(socket), 0, 0, Clock::now(), {}, {}};
  return &routes_.emplace(key, std::move(route)).first->second;
}

Status Relay::EvictIdleRoute() {
  if (routes_.size() < limits_.routes) return Status();
  auto oldest = routes_.end();
  for (auto it = routes_.begin(); it != routes_.end(); ++it) {
    const bool idle = it->second.carried.empty();
    if (idle && (oldest == routes_.end() || it->second.last_use < oldest->second.last_use)) {
      oldest = it;
    }
  }
  if (oldest == routes_.end()) {
    return Status(StatusCode::kLimitExceeded,
                  fmt::format("the gateway relays for {} sessions and connections, at most {}",
                              routes_.size(), limits_.routes));
  }
  Drop(oldest);
  return Status();
}

// A copy helps where a message was lost, but takes no room from requests that have not been passed
// on: it gets what is left of half the bytes. What a replaced process held is sent again anyway.
bool Relay::HasRoomForCopy(const Route& route, size_t bytes) const {
  return route.bytes + bytes <= limits::kMaxRelayRouteBytes / 2 &&
         bytes_ + bytes <= limits_.bytes / 2;
}

Status Relay::Admit(const Route& route, size_t bytes) const {
  const size_t count = route.carried.size();
  if (count >= limits::kMaxRequestsInFlight) {
    return Status(StatusCode::kLimitExceeded,
                  fmt::format("{} requests of this session or connection are being relayed, at "
                              "most {}",
                              count, limits::kMaxRequestsInFlight));
  }
  if (route.bytes + bytes > limits::kMaxRelayRouteBytes ||
      !FitsShare(bytes_, bytes, limits_.bytes)) {
    return Status(
        StatusCode::kLimitExceeded,
        fmt::format("{} bytes of this session or connection and {} of all are being relayed, at "
                    "most {} and {}",
                    route.bytes, bytes_, limits::kMaxRelayRouteBytes, limits_.bytes));
  }
  return Status();
}

void Relay::Pump() {
  if (in_flight_ > 0) {
    for (auto it = routes_.begin(); it != routes_.end();) {
      const bool gone = !it->second.carried.empty() && !HandBackReplies(it->second);
      it = gone ? Drop(it) : std::next(it);
    }
  }
  if (const Clock::time_point now = Clock::now(); !routes_.empty() && now >= next_sweep_) {
    Sweep();
    next_sweep_ = now + kSweepInterval;
  }
}

bool Relay::HandBackReplies(Route& route) {
  for (int i = 0; i < kReplyBurst; ++i) {
    std::optional<Message> message = route.socket.TryReceive();
    if (!message) break;
    RoutingId client = route.last_client;
    if (ParseEnvelope(message->envelope, &reply_).ok()) {
      const auto carried = route.carried.find(reply_.request_id());
      if (carried != route.carried.end()) {
        // This copy was refused, and the one that the replaced process held may have been executed.
        // To the client it would be "not executed", so it is left without an answer and asks again.
        const bool is_unsure = carried->second.resent && reply_.status().recoverable();
        client = std::move(carried->second.client);
        Settle(route, carried);
        if (is_unsure) continue;
      }
    }
    const Status status = send_(client, std::move(*message));
    if (status.code() != StatusCode::kUnavailable) continue;
    SettleAllOf(client, route);
    if (route.carried.empty()) return false;
  }
  const uint32_t connections = route.socket.connections();
  if (connections == route.connections) return true;
  route.connections = connections;
  // Requests that were sent before the first connection are still queued.
  if (connections > 1) SendAgain(route);
  return true;
}

void Relay::SendAgain(Route& route) {
  for (auto& [id, carried] : route.carried) {
    const int64_t remaining_ms = carried.deadline.remaining_ms() - kGraceMs;
    request_.Clear();
    if (remaining_ms <= 0 || !ParseEnvelope(carried.message.envelope, &request_).ok()) continue;
    request_.set_deadline_ms(static_cast<uint32_t>(remaining_ms));
    Result<Frame> envelope = SerializeEnvelope(request_);
    // If the queue is full, the client sends the request again.
    if (!envelope.ok()) continue;
    const Status sent = route.socket.Send({std::move(*envelope), carried.message.payload.Share()});
    carried.resent = carried.resent || sent.ok();
  }
}

void Relay::Settle(Route& route, std::map<uint64_t, Carried>::iterator carried) {
  route.bytes -= carried->second.bytes;
  bytes_ -= carried->second.bytes;
  --in_flight_;
  route.carried.erase(carried);
}

void Relay::SettleAllOf(const RoutingId& client, Route& route) {
  for (auto carried = route.carried.begin(); carried != route.carried.end();) {
    const auto current = carried++;
    if (current->second.client == client) Settle(route, current);
  }
}

Relay::Routes::iterator Relay::Drop(Routes::iterator route) {
  bytes_ -= route->second.bytes;
  in_flight_ -= route->second.carried.size();
  return routes_.erase(route);
}

void Relay::Sweep() {
  const Deadline last_words = Deadline::AfterMs(kGraceMs);
  const Clock::time_point oldest = Clock::now() - std::chrono::milliseconds(limits::kRelayIdleMs);
  for (auto it = routes_.begin(); it != routes_.end();) {
    Route& route = it->second;
    const bool has_ended = !route.token.empty() && !HoldsSession(route);
    for (auto carried = route.carried.begin(); carried != route.carried.end();) {
      const auto current = carried++;
      Deadline& deadline = current->second.deadline;
      if (has_ended && deadline.at() > last_words.at()) deadline = last_words;
      if (deadline.expired()) Settle(route, current);
    }
    // A reply that comes after its request was dropped still reaches its client.
    const bool gone = route.carried.empty() && (route.last_use < oldest || !HandBackReplies(route));
    it = gone ? Drop(it) : std::next(it);
  }
}

void Relay::AppendSockets(std::vector<void*>* sockets) const {
  if (in_flight_ == 0) return;
  for (const auto& [key, route] : routes_) {
    if (!route.carried.empty()) sockets->push_back(route.socket.handle());
  }
}

}  // namespace b4mrl
