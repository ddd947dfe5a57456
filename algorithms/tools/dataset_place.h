// Where a command writes a new dataset: a daemon's data folder, and the file in it. One thread.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "algorithms/tools/command.h"
#include "proto/base/status.h"

namespace b4mrl {

// The two parts of a dataset's name: "HalfCheetah/medium" has folder HalfCheetah and file medium.
struct DatasetName {
  std::string folder, file;
};
// Refuses names that could point outside the data folder, whose parts have letters, digits, '-' and
// '_', and those too long for a file's name.
Result<DatasetName> ParseDatasetName(const std::string& name);

// The name that D4RL gives a file's dataset, "d4rl/halfcheetah-medium-replay-v2" for
// "halfcheetah_medium_replay-v2.hdf5"; "" for files that do not end in ".hdf5". Files of D4RL's
// first version have no version in their names, their "mixed" is the later medium-replay, and
// Walker2d's is "walker_mixed.hdf5".
std::string D4rlDatasetName(const std::string& file_name);

// The dataset's path, "<data>/HalfCheetah/medium.h5"; names "d4rl/..." end with D4RL's ".hdf5".
std::string DatasetPath(const std::string& data_folder, const DatasetName& name);

// Folders that are made for a new file. The destructor removes those that are empty, because the
// file could not be written.
class NewFolders {
 public:
  NewFolders() = default;
  NewFolders(const NewFolders&) = delete;
  NewFolders& operator=(const NewFolders&) = delete;
  ~NewFolders();

  // Makes the folder and its parent folders, as far as they do not exist.
  Status Make(const std::string& folder);

 private:
  std::vector<std::string> made_;  // outer before inner
};

// Members are destroyed in reverse order: first the daemon's connection, then the folders.
class Destination {
 public:
  // Connects to the daemon, or starts a private one, and makes its data folder.
  std::optional<Failure> Open(const DaemonOptions& daemon);
  // Makes the folder of the dataset `name` and keeps its path. Unless `replace`, a file that is
  // there already is an error, whose message ends with `advice`.
  std::optional<Failure> Prepare(const std::string& name, bool replace, std::string_view advice);

  // Whether the data folder has a file of that name.
  bool Has(const std::string& name) const;

  Client& client() { return connection_->client(); }
  const std::string& path() const { return path_; }  // of the dataset that was prepared last

 private:
  NewFolders folders_;
  std::optional<DaemonConnection> connection_;
  std::string data_folder_, path_;
};

}  // namespace b4mrl
