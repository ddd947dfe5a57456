// What is known of dataset files without reading them: what an import found out, kept on disk, and
// which imports failed, kept in memory. Both hold for a file as long as its size, time and inode
// stay what they were.
//
//   DATA/.cache/index/<hash of the name>.json
//
// Any thread.
#pragma once

#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <string>

#include "proto/base/clock.h"
#include "proto/base/status.h"

namespace b4mrl {

struct FileIdentity {
  uint64_t bytes = 0;
  uint64_t modified_ns = 0;
  uint64_t inode = 0;

  // kIoError when it is not there.
  static Result<FileIdentity> Of(const std::string& path);
  bool operator==(const FileIdentity&) const = default;
};

struct ImportedFile {
  FileIdentity file;
  std::string sha256;
  std::string fingerprint;
  std::string behaviour_policy;
  uint64_t rows = 0;
};

class DatasetIndex {
 public:
  explicit DatasetIndex(std::string folder) : folder_(std::move(folder)) {}

  std::optional<ImportedFile> Find(const std::string& name, const FileIdentity& file) const;
  // The folder exists. kIoError, kBusy.
  Status Add(const std::string& name, const ImportedFile& imported) const;

  // Why the file cannot be imported, for ten minutes: what failed for want of memory or time may
  // work later. Of more than 256 failures the oldest are forgotten.
  void AddFailure(const std::string& name, const FileIdentity& file, Status failure);
  Status FindFailure(const std::string& name, const FileIdentity& file) const;

 private:
  struct Failure {
    FileIdentity file;
    Status status;
    Deadline forgotten = Deadline::AfterMs(0);
  };
  std::string PathOf(const std::string& name) const;

  std::string folder_;
  mutable std::mutex mutex_;
  std::map<std::string, Failure> failures_;  // by name; under mutex_
};

}  // namespace b4mrl
