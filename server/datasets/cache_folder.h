// The column caches of a data folder: where they lie, which go when there are too many, and what a
// killed process leaves behind.
//
//   DATA/.cache/<fingerprint>/               a column cache: of a file, or derived from one
//   DATA/.cache/unfinished-<process id>-*/   in the making, or on its way out
//
// Several daemons may share a data folder. Any thread.
#pragma once

#include <cstdint>
#include <string>
#include <utility>

#include "proto/base/status.h"

namespace b4mrl {

// A folder inside the cache's, for one import; it goes with this object.
class ImportFolder {
 public:
  explicit ImportFolder(std::string path) : path_(std::move(path)) {}
  ImportFolder(ImportFolder&& other) noexcept : path_(std::exchange(other.path_, std::string())) {}
  ImportFolder& operator=(ImportFolder&&) = delete;
  ~ImportFolder();
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

class CacheFolder {
 public:
  // `max_bytes`: of disk that all caches may take together.
  CacheFolder(std::string data_folder, uint64_t max_bytes);

  uint64_t max_bytes() const { return max_bytes_; }
  std::string PathOf(const std::string& fingerprint) const;
  std::string IndexFolder() const;
  // Makes the folders, where they are missing.
  Status Make() const;
  Result<ImportFolder> MakeImportFolder() const;
  // A cache's time stamp is when it was last used.
  void Touch(const std::string& fingerprint) const;
  // Removes those that were used longest ago until the rest take at most max_bytes, but none that a
  // process has mapped: hold what is not to go. kLimitExceeded if that is not enough.
  Status MakeRoom() const;
  // Removes what dead processes left half-made.
  void RemoveUnfinished() const;

 private:
  std::string data_folder_;
  std::string root_;
  uint64_t max_bytes_;
};

}  // namespace b4mrl
