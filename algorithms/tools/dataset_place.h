// Where a new dataset goes in a daemon's data folder. One thread.
#pragma once

#include <string>
#include <vector>

#include "proto/base/status.h"

namespace b4mrl {

// A dataset's name in its two parts: "HalfCheetah/medium".
struct DatasetName {
  std::string folder, file;
};
// Refuses whatever could point outside the data folder.
Result<DatasetName> ParseDatasetName(const std::string& name);

// "<data>/HalfCheetah/medium.h5"; "d4rl/..." keeps D4RL's ".hdf5".
std::string DatasetPath(const std::string& data_folder, const DatasetName& name);

// Folders that are made for a file. Those that hold nothing when the object goes, because the file
// could not be written, go as well.
class NewFolders {
 public:
  NewFolders() = default;
  NewFolders(const NewFolders&) = delete;
  NewFolders& operator=(const NewFolders&) = delete;
  ~NewFolders();

  // Makes the folder, those above it included, as far as they are not there.
  Status Make(const std::string& folder);

 private:
  std::vector<std::string> made_;  // outer before inner
};

}  // namespace b4mrl
