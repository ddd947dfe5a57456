#include "algorithms/tools/command.h"

#include <cstdlib>
#include <string>
#include <utility>
#include <vector>

namespace b4mrl {

Failure BadUsage(Status status) { return {kExitBadUsage, std::move(status)}; }
Failure BadInput(Status status) { return {kExitBadInput, std::move(status)}; }

Failure FromDaemon(Status status) {
  switch (status.code()) {
    case StatusCode::kUnavailable:
    case StatusCode::kDeadlineExceeded:
    case StatusCode::kSessionLost:
      return {kExitNoDaemon, std::move(status)};
    case StatusCode::kIoError:
    case StatusCode::kDataLoss:
      return {kExitBadInput, std::move(status)};
    case StatusCode::kInternal:
      return {kExitFailed, std::move(status)};
    default:
      return {kExitRefused, std::move(status)};
  }
}

Status UnknownOption(const CLI::App& app, std::string_view option,
                     const std::vector<std::string>& more) {
  std::vector<std::string> names = more;
  for (const CLI::Option* known : app.get_options()) {
    for (const std::string& name : known->get_lnames()) names.push_back("--" + name);
  }
  return UnknownName("option", option.substr(0, option.find('=')), names);
}

void DaemonOptions::AddTo(CLI::App& app) {
  app.add_option("--endpoint", endpoint,
                 "a running daemon, as tcp://HOST:PORT or ipc://PATH; "
                 "without it a private one is started for this command")
      ->envname("B4MRL_ENDPOINT");
  app.add_option("--data", data_folder, "dataset folder of a private daemon")
      ->envname("B4MRL_DATA");
}

Result<DaemonConnection> DaemonConnection::Open(const DaemonOptions& options) {
  DaemonConnection connection;
  std::string endpoint = options.endpoint;
  if (endpoint.empty()) {
    PrivateDaemonOptions daemon_options;
    daemon_options.data_folder = options.data_folder;
    daemon_options.niceness = kDaemonGivesWay;
    B4MRL_ASSIGN_OR_RETURN(PrivateDaemon daemon, PrivateDaemon::Start(daemon_options));
    connection.daemon_.emplace(std::move(daemon));
    endpoint = connection.daemon_->endpoint();
  }
  B4MRL_ASSIGN_OR_RETURN(Client client, Client::Connect(endpoint));
  connection.client_ = std::make_unique<Client>(std::move(client));
  return connection;
}

}  // namespace b4mrl
