// Every request of the protocol, and which of the daemon's servers answers it.
//
// Each server checks its handlers against this table when it is compiled (HandlesAll), the gateway
// relays by it, and the text of refusals is made from it. A new request therefore needs a row here
// and a handler in its server; tests/server/replies fails while the row is missing, and the server
// does not compile while the handler is. Pure functions; any thread.
#pragma once

#include <algorithm>
#include <cstddef>
#include <iterator>

#include "proto/b4mrl.pb.h"
#include "proto/base/status.h"

namespace b4mrl {

enum class Server { kGateway, kWorker, kDatasetWorker };

struct RequestKind {
  pb::Request::PayloadCase payload;
  Server server;  // the server that answers it
  bool from_clients = true;
};

inline constexpr RequestKind kRequestKinds[] = {
    {pb::Request::kHello, Server::kGateway},
    {pb::Request::kCatalogue, Server::kGateway},
    {pb::Request::kServerStatus, Server::kGateway},
    {pb::Request::kOpen, Server::kGateway},
    {pb::Request::kLedger, Server::kGateway},
    {pb::Request::kAttach, Server::kWorker, /*from_clients=*/false},
    {pb::Request::kStep, Server::kWorker},
    {pb::Request::kReset, Server::kWorker},
    {pb::Request::kQuery, Server::kWorker},
    {pb::Request::kSnapshot, Server::kWorker},
    {pb::Request::kRestore, Server::kWorker},
    {pb::Request::kRender, Server::kWorker},
    {pb::Request::kClose, Server::kWorker},
    {pb::Request::kListDatasets, Server::kDatasetWorker},
    {pb::Request::kOpenDataset, Server::kDatasetWorker},
    {pb::Request::kDatasetStats, Server::kDatasetWorker},
    {pb::Request::kSample, Server::kDatasetWorker},
    {pb::Request::kRead, Server::kDatasetWorker},
};

// The row of `table`, an array of structs with a `payload`, for this payload; null if it has none.
template <typename Row, size_t n>
constexpr const Row* FindRow(const Row (&table)[n], pb::Request::PayloadCase payload) {
  const Row* row = std::ranges::find(table, payload, &Row::payload);
  return row == std::end(table) ? nullptr : row;
}

// Whether `handlers` has a row for each request that `server` answers, and no other.
template <typename Row, size_t n>
constexpr bool HandlesAll(Server server, const Row (&handlers)[n]) {
  return std::ranges::all_of(kRequestKinds, [&](const RequestKind& kind) {
    // Counted, because GCC 12 takes a pointer's comparison with null for no constant under UBSan.
    const bool is_handled = std::ranges::count(handlers, kind.payload, &Row::payload) > 0;
    return (kind.server == server) == is_handled;
  });
}

// kUnsupported, with the names of the requests that clients may send to `server`, and where the
// others go.
Status NotAnswered(Server server);

}  // namespace b4mrl
