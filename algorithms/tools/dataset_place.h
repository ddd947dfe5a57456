// The path of a new dataset in a daemon's data folder. One thread.
#pragma once

#include <string>
#include <vector>

#include "proto/base/status.h"

namespace b4mrl {

// The two parts of a dataset's name: "HalfCheetah/medium" has folder HalfCheetah and file medium.
struct DatasetName {
  std::string folder, file;
};
// Refuses names that could point outside the data folder: parts have letters, digits, '-' and '_'.
Result<DatasetName> ParseDatasetName(const std::string& name);

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

}  // namespace b4mrl
