// Where a command writes a new dataset: a daemon's data folder, and the file in it. One thread.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "algorithms/tools/command.h"
#include "algorithms/tools/dataset_place.h"

namespace b4mrl {

// Members are destroyed in reverse order: first the daemon's connection, then the folders.
class Destination {
 public:
  // Connects to the daemon, or starts a private one, and makes its data folder.
  std::optional<Failure> Open(const DaemonOptions& daemon);
  // Makes the folder of the dataset `name` and keeps its path. Unless `replace`, a file that is
  // there already is an error, whose message ends with `advice`.
  std::optional<Failure> Prepare(const std::string& name, bool replace, std::string_view advice);

  Client& client() { return connection_->client(); }
  const std::string& path() const { return path_; }  // of the dataset that was prepared last

 private:
  NewFolders folders_;
  std::optional<DaemonConnection> connection_;
  std::string data_folder_, path_;
};

}  // namespace b4mrl
