// The connection to a daemon: lists its environments, datasets and benchmarks, and opens them.
//
//   auto client = b4mrl::Client::Connect("tcp://127.0.0.1:7700");
//   auto env = client->Make("HalfCheetah", {.simulator = {{"gravity", ""}}, .num_envs = 64});
//
// Errors are Status values with the server's message: kUnavailable (no server answers),
// kVersionMismatch, kUnknownName, kInvalidArgument, kLimitExceeded, kDeadlineExceeded; kUnsupported
// for a perturbation that the environment or dataset cannot have, kFailedPrecondition for a dataset
// whose sizes are not its environment's, kDataLoss and kIoError for files that cannot be read, and
// kInternal for a server that does not keep the protocol. A deadline of 0 means
// limits::kDefaultDeadlineMs; one above limits::kMaxDeadlineMs counts as that. Thread rule: one
// thread at a time may use a Client. Its sessions and datasets are independent of it and of each
// other, each for one thread, and may outlive it. Its benchmarks use it, and may not.
//
// Workers and the dataset worker listen on ports of their own. If such a port does not exist, or
// cannot be reached within limits::kDirectConnectMs, requests go through the gateway, which is
// slower; the Client reports that once. Ports and limits are those of the Hello that Connect waited
// for, and an address that was not reached is not tried again: a Client belongs to one run of the
// daemon. Processes that are replaced keep their ports; for a daemon that was started again with
// other options, connect a new Client.
//
// A Client checks what a server sends, and cannot be crashed by it, but trusts it with memory:
// every connection (of the Client, a session or a dataset) takes frames of up to 64 MiB, one for
// each request in flight, and 128 messages more that ZeroMQ has received and the Client not yet.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "client/connection.h"
#include "client/remote_benchmark.h"
#include "client/remote_dataset.h"
#include "client/remote_environment.h"
#include "proto/b4mrl.pb.h"
#include "proto/base/clock.h"
#include "proto/base/ledger_counts.h"
#include "proto/base/limits.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

class Client {
 public:
  // Waits for the server's Hello, at most `deadline_ms`. Once `*cancelled` is true, every wait of
  // the client, its sessions and its datasets ends with kUnavailable (connection.h).
  static Result<Client> Connect(const std::string& endpoint,
                                int64_t deadline_ms = limits::kDefaultDeadlineMs,
                                const std::atomic<bool>* cancelled = nullptr);

  // From now on the waits of the client, and of sessions and datasets that it opens, are cancelled
  // only when the server does not reply for so long. For a program that needs the server to end in
  // order.
  void DelayCancellation(Clock::duration grace);

  const pb::HelloReply& hello() const { return hello_; }
  // The address given to Connect.
  const std::string& endpoint() const { return endpoint_; }
  // Receives the one report that requests go through the gateway; by default a line on stderr.
  void set_reporter(std::function<void(const std::string&)> reporter);
  // Whether requests to any session or dataset so far went through the gateway.
  bool relayed() const { return relayed_; }
  // All pages of the catalogue as one message; benchmarks only if asked for, as they are many. All
  // pages together have limits::kDefaultDeadlineMs, here and in ListDatasets; kInternal if they
  // take more than 16 MiB.
  Result<pb::CatalogueReply> Catalogue(bool with_benchmarks = false);
  Result<pb::ServerStatusReply> ServerStatus();
  // Opens a ledger: the daemon counts there what the sessions and datasets that name its number in
  // their options use (limits::kMaxLedgers bounds how many there are).
  Result<uint64_t> OpenLedger();
  // The totals of a ledger since it was opened. kUnknownName if the daemon does not have it:
  // another daemon opened it, or it was long unused and had to make room.
  Result<LedgerCounts> ReadLedger(uint64_t ledger);
  // The specification of one environment, without opening it.
  Result<EnvironmentSpec> FindEnvironment(std::string_view name);

  Result<RemoteEnvironment> Make(const std::string& environment, EnvironmentOptions options = {});

  // A benchmark of the catalogue by its name. `ledger` counts what its simulators and datasets use;
  // 0: one that is opened at the first use.
  Result<RemoteBenchmark> FindBenchmark(std::string_view name, uint64_t ledger = 0);

  Result<std::vector<pb::DatasetInfo>> ListDatasets();
  Result<RemoteDataset> OpenDataset(const std::string& dataset, DatasetOptions options = {});

 private:
  Client(Context context, std::string endpoint, Connection gateway,
         const std::atomic<bool>* cancelled);
  // Opens a ledger (0) or reads one.
  Result<pb::LedgerReply> AskLedger(uint64_t ledger);
  // Sends an Open request over `opener` and connects to the session's worker.
  Result<RemoteEnvironment> OpenSession(Connection& opener, const std::string& token,
                                        pb::Request request, const EnvironmentOptions& options);
  // A connection to `address`, or to its local door.
  Result<Connection> ConnectTo(const std::string& address, const std::string& door,
                               const std::string& token);
  // A connection to the process that listens on `port`: directly, or through the gateway.
  Result<Connection> Reach(const pb::Port& port, const std::string& token);
  // The address of `port` on the gateway's host; "" if the port does not exist.
  Result<std::string> AddressOf(const pb::Port& port) const;
  bool CanRelay() const;
  void ReportRelay(const std::string& reason);

  Context context_;
  std::string endpoint_;
  Connection gateway_;
  const std::atomic<bool>* cancelled_;
  Clock::duration grace_{0};  // before it ends a wait
  pb::HelloReply hello_;
  std::set<std::string> unreachable_;  // addresses that did not answer; they are not tried again
  bool relayed_ = false;
  std::function<void(const std::string&)> reporter_;
};

// Converts an environment's description from its message to the type that client and server use.
EnvironmentSpec SpecOf(const pb::EnvironmentInfo& info);

}  // namespace b4mrl
