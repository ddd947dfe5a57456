// What the commands of b4mrl-tools share: exit codes, the connection to a daemon, output.
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
#include "proto/base/status.h"

namespace b4mrl {

enum ExitCode : int {
  kExitDone = 0,
  kExitFailed = 1,  // our own mistake, or a run that diverged
  kExitBadUsage = 2,
  kExitBadInput = 3,
  kExitNoDaemon = 4,
  kExitRefused = 5,  // by the daemon
  kExitInterrupted = 130,
};

// An error with the exit code that it deserves; a plain Status is one from the daemon or from
// files.
struct Failure {
  int exit_code;
  Status status;
};
Failure BadUsage(Status status);
Failure BadInput(Status status);
// Of a status met while a daemon is in use: 4 when it cannot be reached, 3 for files, 5 otherwise.
Failure FromDaemon(Status status);

// "unknown option '--updats'; did you mean '--updates'?" among `app`'s options and `more` names.
Status UnknownOption(const CLI::App& app, std::string_view option,
                     const std::vector<std::string>& more = {});

// A whole number of low..high as an option's value: `app.add_option(...)->transform(Count(1, 9))`.
// proto/base/count.h says how it may be written.
CLI::Validator Count(uint64_t low, uint64_t high);
// Any seed.
CLI::Validator Seed();

// A command: options bound to a CLI11 subcommand, and what runs when it was chosen.
using CommandBody = std::function<std::optional<Failure>()>;
struct Command {
  CLI::App* app;
  CommandBody body;
};

// Each adds its subcommand (dataset and demo: several) to `app`.
std::vector<Command> AddTrainCommand(CLI::App& app, const std::string& command_line);
std::vector<Command> AddEvaluateCommand(CLI::App& app);
std::vector<Command> AddDatasetCommands(CLI::App& app);
std::vector<Command> AddDatasetWriters(CLI::App& group);  // of `dataset`: make and import
std::vector<Command> AddDemoCommands(CLI::App& app);
std::vector<Command> AddListCommand(CLI::App& app);
std::vector<Command> AddStatusCommand(CLI::App& app);

// Where the daemon is: `--endpoint`, else B4MRL_ENDPOINT, else a private one for this command.
struct DaemonOptions {
  std::string endpoint;
  std::string data_folder;  // of a private daemon; "" is its default. Refused beside an endpoint.
  void AddTo(CLI::App& app);
};

class DaemonConnection {
 public:
  // An interrupt (client/interrupt.h) ends every wait of the client.
  static Result<DaemonConnection> Open(const DaemonOptions& options);
  Client& client() { return *client_; }

  // The folder in which the daemon looks for datasets, for a command that wants to write one.
  // kFailedPrecondition where that is not a folder of this machine, or not the same one.
  Result<std::string> DataFolder();

 private:
  std::optional<PrivateDaemon> daemon_;  // outlives the client
  std::unique_ptr<Client> client_;
};

}  // namespace b4mrl
