#include "server/datasets/dataset_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <string_view>
#include <utility>

#include "proto/base/limits.h"
#include "proto/base/spec.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

// Whether a name can travel in messages, whose strings must be UTF-8, and be typed by people.
bool IsPlainName(std::string_view name) {
  return std::ranges::all_of(name, [](char c) { return c > ' ' && c <= '~'; });
}

// N if the name of a file is `name` with the version "-vN"; else -1.
int64_t VersionNumberOf(std::string_view file_name, std::string_view name) {
  if (!file_name.starts_with(name)) return -1;
  file_name.remove_prefix(name.size());
  if (!file_name.starts_with("-v")) return -1;
  const Result<uint64_t> version =
      ParseUnsigned("version", file_name.substr(2), 0, std::numeric_limits<int32_t>::max());
  return version.ok() ? static_cast<int64_t>(*version) : -1;
}

// The extension that a dataset file has in a folder of DATA.
std::string_view ExtensionIn(const std::string& folder) {
  return folder == "d4rl" ? ".hdf5" : ".h5";
}

}  // namespace

Result<std::vector<DatasetFile>> FindDatasetFiles(const std::string& data_folder) {
  std::vector<DatasetFile> files;
  std::error_code error;
  fs::directory_iterator folders(data_folder, error);
  if (error) return IoError("open data folder", data_folder, error.value());
  for (; folders != fs::directory_iterator(); folders.increment(error)) {
    const std::string folder = folders->path().filename().string();
    std::error_code ignored;
    if (folder.starts_with('.') || !folders->is_directory(ignored)) continue;
    fs::directory_iterator entries(folders->path(), ignored);
    for (; !ignored && entries != fs::directory_iterator(); entries.increment(ignored)) {
      const fs::path& path = entries->path();
      std::error_code unknown;
      if (path.extension() != ExtensionIn(folder) || !entries->is_regular_file(unknown)) continue;
      std::string name = folder + "/" + path.stem().string();
      if (!IsPlainName(name)) continue;
      files.push_back({std::move(name), path.string()});
      if (files.size() > limits::kMaxDatasets) {
        return Status(StatusCode::kLimitExceeded, fmt::format("{} has more than {} datasets",
                                                              data_folder, limits::kMaxDatasets));
      }
    }
  }
  if (error) return IoError("read data folder", data_folder, error.value());
  std::ranges::sort(files, {}, &DatasetFile::name);
  return files;
}

Result<DatasetFile> FindDatasetFile(const std::string& data_folder, const std::string& name) {
  B4MRL_ASSIGN_OR_RETURN(const std::vector<DatasetFile> files, FindDatasetFiles(data_folder));
  std::vector<std::string> names;
  const DatasetFile* newest = nullptr;
  int64_t newest_version = -1;
  for (const DatasetFile& file : files) {
    if (file.name == name) return file;
    names.push_back(file.name);
    const int64_t version = VersionNumberOf(file.name, name);
    if (version <= newest_version) continue;
    newest_version = version;
    newest = &file;
  }
  if (newest != nullptr) return *newest;
  return UnknownName("dataset", name, names);
}

}  // namespace b4mrl
