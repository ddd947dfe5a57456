// The folder of a data folder's column caches: where caches lie, which are removed when they take
// too much room, and how the remains of killed processes are removed.
//
//   DATA/.b4mrl-cache/<fingerprint>/        a column cache: of a file, or derived from a cache
//   DATA/.b4mrl-cache/unfinished-<key>-*/   a cache that is being written or removed
//   DATA/.b4mrl-cache/locks/<key>           locked while what the key names is being made
//
// A key is a cache's fingerprint or, of an import, a hash of the dataset's name. Several daemons,
// in containers and on several hosts, may share a data folder: the lock ends with the process that
// holds it, wherever that runs. On a file system without locks, work may be done twice. Any
// thread.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>

#include "proto/base/status.h"
#include "proto/base/unique_fd.h"

namespace b4mrl {

// A folder inside DATA/.b4mrl-cache for one import. The destructor removes it.
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
  // So many caches may lie there, since all are looked at when a new one is made.
  static constexpr size_t kMaxCaches = 1024;

  // `max_bytes`: bytes of disk that all caches may take together.
  CacheFolder(std::string data_folder, uint64_t max_bytes, size_t max_caches = kMaxCaches);

  uint64_t max_bytes() const { return max_bytes_; }
  std::string PathOf(const std::string& fingerprint) const;
  std::string IndexFolder() const;
  // Makes the folders that are missing. kIoError.
  Status Make() const;
  // Waits until no other thread or process makes what `key` names; the lock ends with the
  // descriptor, which is invalid on a file system without locks. kUnavailable soon after
  // `cancelled` turned true, and after ten minutes; kIoError.
  Result<UniqueFd> Lock(const std::string& key, const std::atomic<bool>& cancelled) const;
  Result<ImportFolder> MakeImportFolder(const std::string& key) const;
  // Sets the time stamp of a cache to now: it says when the cache was last used.
  void Touch(const std::string& fingerprint) const;
  // Removes the caches that were used longest ago until at most max_caches are left, which take at
  // most max_bytes. A cache that a process has mapped stays, so callers hold the caches that they
  // need. kLimitExceeded if those alone take more bytes.
  Status MakeRoom() const;
  // Removes them until the disk has room for a cache of `bytes`, whose writing ended with
  // `failure`, if that says that the disk or a quota is full. What a quota has room for is not
  // known, so if that was full, as many bytes of them are removed. Returns whether any was removed,
  // so that what failed may be tried again.
  bool MakeRoomOnDisk(uint64_t bytes, const Status& failure) const;
  // Removes the unfinished caches that nobody makes any more, and the files of locks that nobody
  // holds.
  void RemoveLeftovers() const;

 private:
  std::string LocksFolder() const;
  // kBusy if the lock is held, or its file was removed meanwhile; kUnsupported on a file system
  // without locks; kIoError.
  Result<UniqueFd> TryLock(const std::string& key) const;

  std::string data_folder_;
  std::string root_;
  uint64_t max_bytes_;
  size_t max_caches_;
};

}  // namespace b4mrl
