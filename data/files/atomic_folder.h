// A folder that appears complete or not at all.
//
// Its files are written under a hidden temporary name beside it, "<parent>/.<name>.XXXXXX"; Commit
// gives it its name. Destroyed before Commit, the temporary folder is removed; a killed process
// leaves it behind. Thread rule: one thread. Errors: kIoError with path and reason,
// kFailedPrecondition if something has the folder's name already.
#pragma once

#include <string>

#include "proto/base/status.h"

namespace b4mrl {

class AtomicFolder {
 public:
  // OK if nothing has the name `path`; else the error of Create and Commit.
  static Status CheckAbsent(const std::string& path);
  // Makes the temporary folder; the parent folder of `path` must exist.
  static Result<AtomicFolder> Create(const std::string& path);
  AtomicFolder(AtomicFolder&& other) noexcept;
  AtomicFolder& operator=(AtomicFolder&&) = delete;
  ~AtomicFolder();

  // Where the files are to be written, until Commit.
  const std::string& temporary_path() const { return temporary_path_; }
  Status Commit();

 private:
  AtomicFolder(std::string path, std::string temporary_path);

  std::string path_;
  std::string temporary_path_;  // "" once there is nothing to remove
};

}  // namespace b4mrl
