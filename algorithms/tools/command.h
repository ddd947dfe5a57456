// Shared by the commands of b4mrl-tools: exit codes, options, the connection to a daemon.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "client/client.h"
#include "client/private_daemon.h"
#include "proto/base/exit_codes.h"
#include "proto/base/status.h"
#include "proto/command_line/words.h"

namespace b4mrl {

// An error of a command with the exit code that it causes.
struct Failure {
  int exit_code;
  Status status;
};
Failure BadUsage(Status status);
Failure BadInput(Status status);
// The failure of a command that uses a daemon: exit code 4 if the daemon does not answer or lost
// the session, 3 for errors of files, 1 for kInternal, 5 otherwise.
Failure FromDaemon(Status status);
// The failure of a command that opened a dataset; says which command makes one that is missing.
Failure FromDataset(Status status, const std::string& dataset);

// Refuses to write a file where something is, unless it is a regular file and may be replaced.
// `name` is that of the argument that gives the path.
std::optional<Failure> CheckOutputFile(std::string_view name, const std::string& path,
                                       bool replace);

// Options of several commands that open a dataset: --corruption-seed and --transitions.
void AddCorruptionSeed(CLI::App& app, uint64_t& seed);
void AddTransitions(CLI::App& app, std::string& rule);

// The option --endpoint with its variable; `text` describes it. CheckEndpoint throws CLI11's error
// for an address that is none. It is for a parse_complete_callback, which is called after --help
// has been answered: a variable that is set wrongly must not hide the help.
CLI::Option* AddEndpoint(CLI::App& app, std::string& endpoint, const std::string& text);
void CheckEndpoint(const CLI::Option& option, const std::string& endpoint);

// A command: options bound to a CLI11 subcommand, and the function that runs it.
using CommandBody = std::function<std::optional<Failure>()>;
struct Command {
  CLI::App* app;
  CommandBody body;
};

// These functions add subcommands to `app`: one each; dataset and demo add several.
std::vector<Command> AddTrainCommand(CLI::App& app, const std::string& command_line);
std::vector<Command> AddEvaluateCommand(CLI::App& app);
std::vector<Command> AddDatasetCommands(CLI::App& app);
std::vector<Command> AddDatasetMake(CLI::App& group);
std::vector<Command> AddDatasetImport(CLI::App& group);
std::vector<Command> AddDatasetVerify(CLI::App& group);
std::vector<Command> AddDatasetExport(CLI::App& group);
std::vector<Command> AddDemoCommands(CLI::App& app);
std::vector<Command> AddListCommand(CLI::App& app);
std::vector<Command> AddStatusCommand(CLI::App& app);

// Options that choose a command's daemon: the daemon at `--endpoint` or B4MRL_ENDPOINT, or, without
// an endpoint, a private daemon for this command.
struct DaemonOptions {
  std::string endpoint;
  std::string data_folder;  // of a private daemon; "": the default. Refused with an endpoint.
  // Of further benchmarks, for a private daemon; "": none. Refused with an endpoint.
  std::string suites_folder;
  void AddTo(CLI::App& app);
  void AddSuitesTo(CLI::App& app);
};

class DaemonConnection {
 public:
  // Connects to the daemon of `options`. An interrupt (client/interrupt.h) ends every wait of the
  // client.
  static Result<DaemonConnection> Open(const DaemonOptions& options);
  Client& client() { return *client_; }

  // The daemon's data folder, for a command that writes a dataset. kFailedPrecondition if this
  // process does not reach the same folder by that path, as on another machine.
  Result<std::string> DataFolder();

 private:
  std::optional<PrivateDaemon> daemon_;  // outlives the client
  std::string own_data_folder_;          // of daemon_
  std::unique_ptr<Client> client_;
};

}  // namespace b4mrl
