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
#include <utility>

#include "data/files/atomic_file.h"
#include "proto/base/limits.h"
#include "proto/base/names.h"

namespace b4mrl {

Result<DatasetName> ParseDatasetName(const std::string& name) {
  const size_t slash = std::min(name.find('/'), name.size());
  DatasetName parts = {name.substr(0, slash), name.substr(std::min(slash + 1, name.size()))};
  const auto valid = [](std::string_view part) {
    return !part.empty() && std::all_of(part.begin(), part.end(), [](unsigned char c) {
      return std::isalnum(c) != 0 || c == '-' || c == '_';
    });
  };
  if (!valid(parts.folder) || !valid(parts.file) || name.size() > limits::kMaxNewDatasetNameBytes) {
    return InvalidArgument("dataset", name,
                           fmt::format("ENVIRONMENT/NAME of letters, digits, '-' and '_', {} "
                                       "characters at most",
                                       limits::kMaxNewDatasetNameBytes));
  }
  return parts;
}

std::string D4rlDatasetName(const std::string& file_name) {
  constexpr std::string_view kEnding = ".hdf5";
  constexpr std::string_view kMixed = "-mixed-", kWalker = "walker-";
  if (!file_name.ends_with(kEnding)) return "";
  std::string name = file_name.substr(0, file_name.size() - kEnding.size());
  std::ranges::replace(name, '_', '-');
  if (VersionOf(name).empty()) name += "-v0";
  if (const size_t mixed = name.find(kMixed); mixed != std::string::npos) {
    name.replace(mixed, kMixed.size(), "-medium-replay-");
  }
  if (name.starts_with(kWalker)) name.insert(kWalker.size() - 1, "2d");
  return "d4rl/" + name;
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

std::optional<Failure> Destination::Open(const DaemonOptions& daemon) {
  if (!daemon.data_folder.empty()) {
    if (Status status = folders_.Make(daemon.data_folder); !status.ok()) {
      return BadInput(std::move(status));
    }
  }
  auto connection = DaemonConnection::Open(daemon);
  if (!connection.ok()) return FromDaemon(connection.status());
  connection_.emplace(*std::move(connection));
  auto data_folder = connection_->DataFolder();
  if (!data_folder.ok()) return FromDaemon(data_folder.status());
  data_folder_ = *std::move(data_folder);
  return std::nullopt;
}

bool Destination::Has(const std::string& name) const {
  const auto parts = ParseDatasetName(name);
  std::error_code error;
  return parts.ok() && std::filesystem::exists(DatasetPath(data_folder_, *parts), error);
}

std::optional<Failure> Destination::Prepare(const std::string& name, bool replace,
                                            std::string_view advice) {
  const auto parts = ParseDatasetName(name);
  if (!parts.ok()) return BadInput(parts.status());
  path_ = DatasetPath(data_folder_, *parts);
  if (std::error_code error; !replace && std::filesystem::exists(path_, error)) {
    return BadInput(
        Status(StatusCode::kFailedPrecondition, fmt::format("{} exists; {}", path_, advice)));
  }
  if (Status status = folders_.Make(FolderOf(path_)); !status.ok()) {
    return BadInput(std::move(status));
  }
  return std::nullopt;
}

}  // namespace b4mrl
