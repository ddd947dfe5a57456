#include "data/files/atomic_folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <system_error>
#include <utility>

#include "data/files/atomic_file.h"

namespace b4mrl {
namespace {

Status Exists(const std::string& path) {
  return Status(StatusCode::kFailedPrecondition, fmt::format("{} exists", path));
}

}  // namespace

AtomicFolder::AtomicFolder(std::string path, std::string temporary_path)
    : path_(std::move(path)), temporary_path_(std::move(temporary_path)) {}

AtomicFolder::AtomicFolder(AtomicFolder&& other) noexcept
    : path_(std::move(other.path_)), temporary_path_(std::exchange(other.temporary_path_, "")) {}

AtomicFolder::~AtomicFolder() {
  if (temporary_path_.empty()) return;
  std::error_code ignored;
  std::filesystem::remove_all(temporary_path_, ignored);
}

Status AtomicFolder::CheckAbsent(const std::string& path) {
  std::error_code error;
  return std::filesystem::exists(path, error) ? Exists(path) : Status();
}

Result<AtomicFolder> AtomicFolder::Create(const std::string& path) {
  B4MRL_RETURN_IF_ERROR(CheckAbsent(path));
  const std::string parent = FolderOf(path);
  std::string temporary =
      fmt::format("{}/.{}.XXXXXX", parent, std::filesystem::path(path).filename().string());
  if (mkdtemp(temporary.data()) == nullptr) return IoError("create folder", temporary, errno);
  AtomicFolder folder(path, temporary);
  // mkdtemp gives the folder to its user alone.
  if (chmod(temporary.c_str(), ModeInside(parent)) != 0) {
    return IoError("set the mode of", temporary, errno);
  }
  return folder;
}

Status AtomicFolder::Commit() {
  B4MRL_RETURN_IF_ERROR(SyncFolder(temporary_path_));
  // Unlike rename, this replaces no empty folder.
  if (RenameIfAbsent(temporary_path_.c_str(), path_.c_str()) != 0) {
    const bool exists = errno == EEXIST || errno == ENOTEMPTY;
    return exists ? Exists(path_) : IoError("create folder", path_, errno);
  }
  temporary_path_.clear();
  return SyncFolder(FolderOf(path_));
}

}  // namespace b4mrl
