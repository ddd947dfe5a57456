// The command line of `b4mrl-serve`. Flags override the configuration file, and the file overrides
// defaults. Value types.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "server/process/child.h"

namespace b4mrl {

struct ServeOptions : CommonOptions {
  std::vector<std::string> binds;  // "tcp://HOST:PORT" or "ipc://PATH"; port 0 picks a free one
  uint32_t workers = 0;
  uint32_t lease_seconds = 0;  // a session without requests ends after this; 0: the default
  bool insecure = false;       // allow addresses that other machines can reach
  bool single_port = false;    // clients reach the gateway alone, which relays
  bool no_door = false;        // clients of this machine use sockets, too
  bool own_folder = false;     // the folder of the first ipc address ends with the daemon
};

struct CommandLine {
  ServeOptions serve;
  // Set in a process that the supervisor started; `shared_memory_fd` and `child` hold then.
  bool is_child = false;
  int shared_memory_fd = -1;
  ChildOptions child;
  // Options of the roles that read untrusted files: `importer`, which the dataset worker starts,
  // and `model-compiler`, which the gateway starts.
  std::string untrusted_file;
  std::string cache_folder;
  std::string trial_name;
  uint64_t cache_bytes = 0;
  std::string environment;
};

// Parses the command line and fills in defaults. After an error, --help or --version, whose text it
// prints, returns nothing and sets `*exit_code`.
std::optional<CommandLine> ParseCommandLine(int argc, char** argv, int* exit_code);

// The arguments with which the supervisor starts a child; ParseCommandLine is their inverse.
std::vector<std::string> ChildArguments(const ChildOptions& child, int shared_memory_fd);

}  // namespace b4mrl
