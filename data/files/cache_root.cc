#include "data/files/cache_root.h"

#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>

#include "data/files/atomic_file.h"
#include "data/files/make_folder.h"
#include "proto/base/folders.h"
#include "proto/base/rng.h"

namespace b4mrl {
namespace {

Status MakeFolderWithMode(const std::string& path, mode_t mode) {
  if (mkdir(path.c_str(), mode) != 0 && errno != EEXIST) return IoError("create", path, errno);
  struct stat info {};
  if (stat(path.c_str(), &info) != 0) return IoError("inspect", path, errno);
  if (!S_ISDIR(info.st_mode)) return IoError("create", path, ENOTDIR);
  // EPERM is no error: another member of the group owns the folder, and its mode stays.
  if ((info.st_mode & 02777) != mode && chmod(path.c_str(), mode) != 0 && errno != EPERM) {
    return IoError("set the mode of", path, errno);
  }
  return Status();
}

std::string InDataFolder(const std::string& data_folder) { return data_folder + "/.b4mrl-cache"; }

// Whether this process may write to a folder, or to the folder in which it would have to be made.
bool MayWriteTo(const std::string& folder) {
  std::error_code error;
  std::filesystem::path path =
      std::filesystem::weakly_canonical(std::filesystem::absolute(folder, error), error);
  // access() heeds file systems that are mounted read-only, for root, too.
  while (!error && access(path.c_str(), W_OK) != 0) {
    if (errno != ENOENT || path == path.parent_path()) return false;
    path = path.parent_path();
  }
  return !error;
}

}  // namespace

std::string CacheRoot(const std::string& data_folder) {
  const std::string usual = InDataFolder(data_folder);
  if (MayWriteTo(usual)) return usual;
  const std::string users = DefaultCacheFolder();
  if (users.empty()) return usual;
  std::error_code error;
  const std::filesystem::path path = std::filesystem::weakly_canonical(data_folder, error);
  return fmt::format("{}/data-{:016x}", users, HashName(error ? data_folder : path.string()));
}

Status MakeCacheRoot(const std::string& data_folder) {
  const std::string root = CacheRoot(data_folder);
  if (root != InDataFolder(data_folder)) {
    B4MRL_RETURN_IF_ERROR(MakeFolder(FolderOf(root)));
    return MakeFolderWithMode(root, 0700);
  }
  B4MRL_RETURN_IF_ERROR(MakeFolder(data_folder));
  const mode_t mode = ModeInside(data_folder);
  Status made = MakeFolderWithMode(root, (mode & S_IWGRP) != 0 ? mode : 0700);
  if (made.ok() || !DefaultCacheFolder().empty()) return made;
  return Status(made.code(), made.message() + "; XDG_CACHE_HOME may name a folder for it");
}

Status MakeFolderInside(const std::string& folder) {
  return MakeFolderWithMode(folder, ModeInside(FolderOf(folder)));
}

}  // namespace b4mrl
