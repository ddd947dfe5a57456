// The entrance to a daemon: says Hello, lists what there is, opens sessions and datasets.
//
//   auto client = b4mrl::Client::Connect("tcp://127.0.0.1:7700");
//   auto env = client->Make("HalfCheetah", {.simulator = {{"gravity", ""}}, .num_envs = 64});
//
// Errors are Status values with the server's own words: kUnavailable (cannot be reached),
// kVersionMismatch, kUnknownName, kInvalidArgument, kLimitExceeded, kDeadlineExceeded. Thread rule:
// one thread at a time. Sessions and datasets that it made are independent of it and of each other,
// each for one thread; the Client must outlive them.
//
// Sessions and datasets are reached on ports of their own. Where such a port cannot be reached
// within limits::kDirectConnectMs, or does not exist, requests go through the gateway, which is
// slower; the first time that this happens, the Client says so.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "client/connection.h"
#include "client/remote_dataset.h"
#include "client/remote_environment.h"
#include "proto/b4mrl.pb.h"
#include "proto/base/limits.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

class Client {
 public:
  // Waits for the server's Hello, at most `deadline_ms`. Once `*cancelled` is true, every wait of
  // the client and of what it opened ends with kUnavailable (connection.h).
  static Result<Client> Connect(const std::string& endpoint,
                                int64_t deadline_ms = limits::kDefaultDeadlineMs,
                                const std::atomic<bool>* cancelled = nullptr);

  const pb::HelloReply& hello() const { return hello_; }
  // As given to Connect: another process can connect to it, too.
  const std::string& endpoint() const { return endpoint_; }
  // Where the one report of the slower way goes; a line on stderr by default.
  void set_reporter(std::function<void(const std::string&)> reporter);
  // Whether anything went the slower way so far.
  bool relayed() const { return relayed_; }
  // All pages of the catalogue as one message.
  Result<pb::CatalogueReply> Catalogue();
  Result<pb::ServerStatusReply> ServerStatus();
  // The specification of one environment, without opening it.
  Result<EnvironmentSpec> FindEnvironment(std::string_view name);

  Result<RemoteEnvironment> Make(const std::string& environment, EnvironmentOptions options = {});

  Result<std::vector<pb::DatasetInfo>> ListDatasets();
  Result<RemoteDataset> OpenDataset(const std::string& dataset, DatasetOptions options = {});

 private:
  Client(std::unique_ptr<Context> context, std::string endpoint, Connection gateway,
         const std::atomic<bool>* cancelled);
  // What Make does with its Open request, which goes over `opener`.
  Result<RemoteEnvironment> OpenSession(Connection& opener, const std::string& token,
                                        pb::Request request, const EnvironmentOptions& options);
  // A connection to the process that listens on `port`: directly, or through the gateway.
  Result<Connection> Reach(const pb::Port& port, const std::string& token);
  // "" if the port does not exist.
  Result<std::string> AddressOf(const pb::Port& port) const;
  bool CanRelay() const;
  void ReportRelay(const std::string& reason);

  std::unique_ptr<Context> context_;
  std::string endpoint_;
  Connection gateway_;
  const std::atomic<bool>* cancelled_;
  pb::HelloReply hello_;
  std::set<std::string> unreachable_;  // addresses that did not answer; not tried again
  bool relayed_ = false;
  std::function<void(const std::string&)> reporter_;
};

// The wire's description of an environment as the type that both sides use.
EnvironmentSpec SpecOf(const pb::EnvironmentInfo& info);

}  // namespace b4mrl
