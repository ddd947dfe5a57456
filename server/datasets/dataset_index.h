// Remembers the results of imports, so that files need not be read again: facts about imported
// files on disk, failures in memory. An entry holds as long as the file's size, time of change and
// inode stay the same.
//
//   DATA/.b4mrl-cache/index/<hash of the name>.json
//
// Any thread.
#pragma once

#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <string>

#include "data/d4rl/import_dataset.h"
#include "proto/base/clock.h"
#include "proto/base/status.h"

namespace b4mrl {

struct FileIdentity {
  uint64_t bytes = 0;
  uint64_t modified_ns = 0;
  uint64_t inode = 0;

  // Of the file at `path`; kIoError when there is none.
  static Result<FileIdentity> Of(const std::string& path);
  bool operator==(const FileIdentity&) const = default;
};

struct ImportedFile {
  FileIdentity file;
  std::string sha256;          // of the file
  std::string columns_sha256;  // of the rows (data/columns/columns_hash.h)
  std::string fingerprint;
  ImportedDataset contents;
};

class DatasetIndex {
 public:
  explicit DatasetIndex(std::string folder) : folder_(std::move(folder)) {}

  // A hash of a dataset's name, which names the index's entry and the lock of the file's import.
  static std::string KeyOf(const std::string& name);

  std::optional<ImportedFile> Find(const std::string& name, const FileIdentity& file) const;
  // The index's folder must exist. kIoError, kBusy.
  Status Add(const std::string& name, const ImportedFile& imported) const;

  // Why the file cannot be imported. Kept for ten minutes, as an import that failed for want of
  // memory or time may work later, and for the latest 256 failures.
  void AddFailure(const std::string& name, const FileIdentity& file, Status failure);
  // The failure that is kept for the file, or OK.
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
