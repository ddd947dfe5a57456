#include "data/files/cache_root.h"

#include <sys/stat.h>

#include <cerrno>

#include "data/files/atomic_file.h"

namespace b4mrl {
namespace {

Status MakeFolder(const std::string& path, mode_t mode) {
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

}  // namespace

std::string CacheRoot(const std::string& data_folder) { return data_folder + "/.cache"; }

Status MakeCacheRoot(const std::string& data_folder) {
  const mode_t mode = ModeInside(data_folder);
  return MakeFolder(CacheRoot(data_folder), (mode & S_IWGRP) != 0 ? mode : 0700);
}

Status MakeFolderInside(const std::string& folder) {
  return MakeFolder(folder, ModeInside(FolderOf(folder)));
}

}  // namespace b4mrl
