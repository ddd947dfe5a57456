// A daemon of the build under test, and a client of it. For tests.
#pragma once

#include <string>

#include "client/client.h"
#include "client/private_daemon.h"
#include "tests/data/temporary_folder.h"
#include "tests/results.h"

namespace b4mrl {

// This test program's data folder, without datasets: never the user's own.
inline const std::string& EmptyDataFolder() {
  static const TemporaryFolder folder;
  return folder.path();
}

// Starts it with `options`; unless they say otherwise it is b4mrl-serve on EmptyDataFolder().
inline PrivateDaemon StartDaemon(PrivateDaemonOptions options = {}) {
  if (options.binary.empty()) options.binary = B4MRL_BINARY_DIR "/b4mrl-serve";
  if (options.data_folder.empty()) options.data_folder = EmptyDataFolder();
  return Take(PrivateDaemon::Start(options));
}

inline Client Connect(const std::string& endpoint) { return Take(Client::Connect(endpoint)); }

}  // namespace b4mrl
