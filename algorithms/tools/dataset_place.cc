#include "algorithms/tools/dataset_place.h"

#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <filesystem>
#include <string_view>
#include <system_error>

namespace b4mrl {

Result<DatasetName> ParseDatasetName(const std::string& name) {
  const size_t slash = std::min(name.find('/'), name.size());
  DatasetName parts = {name.substr(0, slash), name.substr(std::min(slash + 1, name.size()))};
  const auto valid = [](std::string_view part) {
    return !part.empty() && std::all_of(part.begin(), part.end(), [](unsigned char c) {
      return std::isalnum(c) != 0 || c == '-' || c == '_';
    });
  };
  if (!valid(parts.folder) || !valid(parts.file)) {
    return InvalidArgument("dataset", name, "ENVIRONMENT/NAME of letters, digits, '-' and '_'");
  }
  return parts;
}

std::string DatasetPath(const std::string& data_folder, const DatasetName& name) {
  return fmt::format("{}/{}/{}{}", data_folder, name.folder, name.file,
                     name.folder == "d4rl" ? ".hdf5" : ".h5");
}

Status NewFolders::Make(const std::string& folder) {
  std::filesystem::path path;
  // Make folders one by one, to know which of them are new.
  for (const std::filesystem::path& part : std::filesystem::path(folder)) {
    path /= part;
    if (mkdir(path.c_str(), 0777) == 0) {
      made_.push_back(path);
      continue;
    }
    const int reason = errno;
    std::error_code error;
    if (!std::filesystem::is_directory(path, error))
      return IoError("create", path.string(), reason);
  }
  return Status();
}

NewFolders::~NewFolders() {
  // rmdir does not remove a folder that is not empty.
  for (auto folder = made_.rbegin(); folder != made_.rend(); ++folder) rmdir(folder->c_str());
}

}  // namespace b4mrl
