// The dataset files of a data folder, and their names: DATA/<Environment>/<level>.h5 is
// "<Environment>/<level>", DATA/d4rl/<name>.hdf5 is "d4rl/<name>". Links to files count as files;
// folders, pipes and dangling links do not. Any thread.
#pragma once

#include <string>
#include <vector>

#include "proto/base/status.h"

namespace b4mrl {

struct DatasetFile {
  std::string name;
  std::string path;
};

// All files, sorted by name. kIoError when the folder cannot be read; kLimitExceeded.
Result<std::vector<DatasetFile>> FindDatasetFiles(const std::string& data_folder);
// The file of that name, else the newest of its versions: "HalfCheetah/medium-v1" for
// "HalfCheetah/medium". kUnknownName, with the nearest name.
Result<DatasetFile> FindDatasetFile(const std::string& data_folder, const std::string& name);

}  // namespace b4mrl
