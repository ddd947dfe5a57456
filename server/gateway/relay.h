// Carries the requests of clients that reach only the gateway's port to the process that answers
// them, and the replies back.
//
// A session for which the gateway gets a Step or another request that a worker answers has a route:
// a connection of its own from the gateway to its worker, which is found by the token. A client
// that sends a Sample or another request about datasets has one to the dataset worker. That process
// sees a client like any other, so request ids, lane numbers, deadlines and limits mean the same as
// without the relay, and a reply reaches the sender of its request's latest copy only. The relay
// keeps each request until it is answered, its deadline has passed or its session has ended, and
// sends it again when the process at the other end was replaced, because the client cannot see
// that. The relay's state need not survive the gateway: clients see their connection break and send
// again.
//
// A request is carried once, whatever number of connections its copies come over: a client that has
// reconnected sends it again, and the process answers once. Were each connection's copy kept, those
// of connections that have gone would take up the relay until their deadline.
//
// No call waits, so no client can hold up the gateway; limits::kMaxRequestsInFlight,
// limits::kMaxRelay* and Limits bound every queue. Thread rule: the gateway's main thread.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <unordered_map>
#include <vector>

#include "proto/b4mrl.pb.h"
#include "proto/base/clock.h"
#include "proto/base/limits.h"
#include "proto/base/status.h"
#include "proto/wire/socket.h"
#include "server/shared_memory/session_table.h"
#include "server/shared_memory/shared_state.h"

namespace b4mrl {

class Relay {
 public:
  using SendFunction = std::function<Status(const RoutingId& client, Message reply)>;
  // Where the processes listen.
  struct Addresses {
    std::vector<std::string> workers;
    std::string dataset_worker;
  };

  struct Limits {
    size_t bytes = limits::kMaxRelayBytes;  // of all routes, where more than one request is relayed
    size_t routes = limits::kMaxRelayRoutes;
  };

  // Replies leave through `send`. What is passed by reference outlives the relay.
  Relay(Context& sockets, SharedState& shared, Addresses addresses, SendFunction send,
        Limits limits);

  // Sends `message`, whose parsed envelope is `request`, to the process that answers it. An error
  // says why it was not sent: kSessionLost when the token names no session, kInvalidArgument when
  // its id is under way with other contents, kLimitExceeded, kIoError.
  Status Forward(const RoutingId& client, const pb::Request& request, Message message);
  // Hands back the replies that have come, sends the requests of a replaced process again, and
  // drops requests whose deadline has passed or whose session has ended, and routes that are idle.
  void Pump();

  // The number of requests that are neither answered nor past their deadline.
  size_t in_flight() const { return in_flight_; }
  // Adds the sockets on which replies may come.
  void AppendSockets(std::vector<void*>* sockets) const;

 private:
  struct Carried {
    RoutingId client;  // that sent the latest copy
    Message message;   // shares its bytes with the message that was sent
    Deadline deadline;
    size_t bytes;         // of all copies of the request that were sent
    bool resent = false;  // by the relay itself, of which the client does not know
  };
  struct Route {
    uint32_t process;   // index into addresses_
    uint32_t session;   // index of the session's record; kMaxSessions for the dataset worker
    std::string token;  // of the session; empty for the dataset worker
    DealerSocket socket;
    uint32_t connections = 0;
    size_t bytes = 0;  // of all requests in `carried`
    Clock::time_point last_use;
    // Gets replies to requests that are not carried any more.
    RoutingId last_client;
    std::map<uint64_t, Carried> carried;  // by request id
  };
  using Routes = std::unordered_map<std::string, Route>;

  // Whether the route's session, which it has, still is its worker's.
  bool HoldsSession(const Route& route) const;
  Result<Route*> FindOrMakeRoute(const RoutingId& client, const pb::Request& request);
  Result<Route*> MakeRoute(const std::string& key, uint32_t process, uint32_t session,
                           const std::string& token);
  Status ForwardCopy(Route& route, Carried& carried, const RoutingId& client,
                     const pb::Request& request, Message message);
  // Whether `message`, whose envelope is `request`, says the same as an earlier one of its id.
  bool IsCopy(const Message& earlier, const pb::Request& request, const Message& message);
  // Makes room for one more route: kLimitExceeded when every route has a request in flight.
  Status EvictIdleRoute();
  Status Admit(const Route& route, size_t bytes) const;
  bool HasRoomForCopy(const Route& route, size_t bytes) const;
  // Passes the route's replies on. False when the route is of no use, as the client for which it
  // carried the last requests has gone.
  bool HandBackReplies(Route& route);
  void SendAgain(Route& route);
  void Settle(Route& route, std::map<uint64_t, Carried>::iterator carried);
  void SettleAllOf(const RoutingId& client, Route& route);
  Routes::iterator Drop(Routes::iterator route);
  void Sweep();

  Context& sockets_;
  SharedState& shared_;
  SessionTable table_;
  std::vector<std::string> addresses_;  // of the workers, then of the dataset worker
  SendFunction send_;
  const Limits limits_;
  Routes routes_;  // by token, those to the dataset worker by client
  size_t in_flight_ = 0;
  size_t bytes_ = 0;
  Clock::time_point next_sweep_{};
  pb::Request request_;  // reused by every message
  pb::Reply reply_;      // reused by every message
};

}  // namespace b4mrl
