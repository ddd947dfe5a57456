// A daemon of the build under test, and a client of it. For tests.
#pragma once

#include <filesystem>
#include <string>
#include <utility>

#include "client/client.h"
#include "client/private_daemon.h"
#include "tests/results.h"

namespace b4mrl {

// Starts it with `options`. Unless they say otherwise it is b4mrl-serve, and its data folder one
// without datasets: never the user's own.
inline PrivateDaemon StartDaemon(PrivateDaemonOptions options = {}) {
  if (options.binary.empty()) options.binary = B4MRL_BINARY_DIR "/b4mrl-serve";
  if (options.data_folder.empty()) options.data_folder = std::filesystem::temp_directory_path();
  return Take(PrivateDaemon::Start(options));
}

inline Client Connect(const std::string& endpoint) { return Take(Client::Connect(endpoint)); }

}  // namespace b4mrl
