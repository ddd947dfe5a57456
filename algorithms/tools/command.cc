#include "algorithms/tools/command.h"

#include <fmt/format.h>

#include <cerrno>
#include <filesystem>
#include <string>
#include <system_error>
#include <utility>

#include "algorithms/datasets/dataset_recipes.h"
#include "client/interrupt.h"
#include "proto/base/folders.h"
#include "proto/base/limits.h"

namespace b4mrl {

namespace {

// Adds to an error of an unreachable daemon how to start one.
Status ExplainUnreachable(Status status, bool is_private) {
  if (status.code() != StatusCode::kUnavailable || Interrupted()) return status;
  const std::string text = status.message() + "; is it running? `b4mrl serve` starts one";
  if (is_private) return Status(status.code(), text);
  return Status(status.code(), text + "; the address is that of --endpoint or B4MRL_ENDPOINT");
}

}  // namespace

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

Failure FromDataset(Status status, const std::string& dataset) {
  const bool is_missing = status.code() == StatusCode::kUnknownName &&
                          status.message().starts_with("unknown dataset ");  // and no corruption
  const DatasetRecipe* const recipe = is_missing ? FindRecipe(dataset) : nullptr;
  if (recipe == nullptr || !recipe->missing.empty()) return FromDaemon(std::move(status));
  return FromDaemon(Status(status.code(), fmt::format("{}; `b4mrl dataset make {}` makes it",
                                                      status.message(), dataset)));
}

std::optional<Failure> CheckOutputFile(std::string_view name, const std::string& path,
                                       bool replace) {
  std::error_code unknown;  // what cannot be looked at cannot be written either
  if (!std::filesystem::exists(path, unknown)) return std::nullopt;
  if (!replace) return BadInput(InvalidArgument(name, path, "a new file, or --replace"));
  // A device, such as /dev/null, must not become a file.
  if (std::filesystem::is_regular_file(path, unknown)) return std::nullopt;
  return BadInput(InvalidArgument(name, path, "a regular file to replace"));
}

void AddCorruptionSeed(CLI::App& app, uint64_t& seed) {
  app.add_option("--corruption-seed", seed,
                 "seed of the corruptions' noise: each seed gives a dataset one noise matrix, "
                 "whatever is trained on it [0]")
      ->transform(Seed());
}

void AddTransitions(CLI::App& app, std::string& rule) {
  app.add_option(
         "--transitions", rule,
         "rule for next observations: \"stored\" takes those of the file, \"d4rl\" the next "
         "row's observation, without rows that end by time-out [stored]")
      ->check(CLI::IsMember({"stored", "d4rl"}));
}

CLI::Option* AddEndpoint(CLI::App& app, std::string& endpoint, const std::string& text) {
  return app.add_option("--endpoint", endpoint, text)->envname("B4MRL_ENDPOINT");
}

void CheckEndpoint(const CLI::Option& option, const std::string& endpoint) {
  if (option.count() == 0) return;
  if (const Status status = CheckAddress(endpoint); !status.ok()) {
    throw CLI::ValidationError("--endpoint or B4MRL_ENDPOINT", status.message());
  }
}

void DaemonOptions::AddTo(CLI::App& app) {
  const CLI::Option* const option = AddEndpoint(
      app, endpoint,
      "address of a running daemon, tcp://HOST:PORT or ipc://PATH [a private daemon is started for "
      "this command]");
  app.add_option("--data", data_folder,
                 "folder of datasets for the private daemon [that of `b4mrl serve --data`]; "
                 "a running daemon has its own");
  app.parse_complete_callback([this, option] {
    CheckEndpoint(*option, endpoint);
    const auto refuse = [this](const char* flag, const std::string& folder, const char* what) {
      if (endpoint.empty() || folder.empty()) return;
      throw CLI::ValidationError(flag,
                                 fmt::format("{} is not used: the {} are those of the daemon at {} "
                                             "(--endpoint or B4MRL_ENDPOINT)",
                                             folder, what, endpoint));
    };
    refuse("--data", data_folder, "datasets");
    refuse("--suites", suites_folder, "benchmarks");
  });
}

void DaemonOptions::AddSuitesTo(CLI::App& app) {
  app.add_option("--suites", suites_folder,
                 "folder of further suites, for the private daemon; a running daemon has its own");
}

Result<DaemonConnection> DaemonConnection::Open(const DaemonOptions& options) {
  DaemonConnection connection;
  std::string endpoint = options.endpoint;
  if (endpoint.empty()) {
    for (const auto& [action, folder] : {std::pair{"use --data", options.data_folder},
                                         std::pair{"use --suites", options.suites_folder}}) {
      std::error_code error;
      if (folder.empty() || std::filesystem::is_directory(folder, error)) continue;
      return IoError(action, folder, error ? error.value() : ENOTDIR);
    }
    PrivateDaemonOptions daemon_options;
    if (!options.suites_folder.empty()) {
      daemon_options.arguments = {"--suites", options.suites_folder};
    }
    daemon_options.data_folder = options.data_folder;
    connection.own_data_folder_ =
        options.data_folder.empty() ? DefaultDataFolder() : options.data_folder;
    daemon_options.niceness = kDaemonGivesWay;
    B4MRL_ASSIGN_OR_RETURN(PrivateDaemon daemon, PrivateDaemon::Start(daemon_options));
    connection.daemon_.emplace(std::move(daemon));
    endpoint = connection.daemon_->endpoint();
  }
  Result<Client> client = Client::Connect(endpoint, limits::kDefaultDeadlineMs, &Interrupted());
  if (!client.ok()) return ExplainUnreachable(client.status(), options.endpoint.empty());
  connection.client_ = std::make_unique<Client>(*std::move(client));
  return connection;
}

Result<std::string> DaemonConnection::DataFolder() {
  B4MRL_ASSIGN_OR_RETURN(const pb::ServerStatusReply status, client_->ServerStatus());
  // What a daemon says of its folder is text, which a path need not be.
  const std::string& folder = daemon_ ? own_data_folder_ : status.data_folder();
  if (folder.empty()) {
    return Status(StatusCode::kFailedPrecondition,
                  "the daemon is older than this command and does not say where its datasets are");
  }
  if (status.data_folder_id() == 0) {
    return Status(StatusCode::kFailedPrecondition,
                  fmt::format("the daemon's data folder, {}, does not exist or cannot be read: let "
                              "--data or B4MRL_DATA name another one when the daemon begins",
                              folder));
  }
  if (FolderIdentity(folder) != status.data_folder_id()) {
    return Status(StatusCode::kFailedPrecondition,
                  fmt::format("the daemon's data folder, {}, is not a folder that this command can "
                              "reach: run it where the daemon runs, or without an endpoint",
                              folder));
  }
  return folder;
}

}  // namespace b4mrl
