#include "server/datasets/cache_folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <spdlog/spdlog.h>
#include <sys/file.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <vector>

#include "data/columns/column_cache.h"
#include "data/files/atomic_file.h"
#include "data/files/cache_root.h"
#include "data/files/file_hash.h"
#include "data/files/stored_bytes.h"
#include "proto/base/clock.h"
#include "server/datasets/corruption.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

// The entries of a folder, as far as it can be read. (A range-for over the iterator would throw.)
std::vector<fs::path> EntriesOf(const fs::path& folder) {
  std::vector<fs::path> entries;
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    entries.push_back(it->path());
  }
  return entries;
}

uint64_t FolderBytes(const fs::path& folder) {
  uint64_t total = 0;
  for (const fs::path& file : EntriesOf(folder)) {
    total += StoredBytes(UniqueFd(open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK)).get());
  }
  return total;
}

void TouchPath(const std::string& folder) { utimensat(AT_FDCWD, folder.c_str(), nullptr, 0); }

}  // namespace

ImportFolder::~ImportFolder() {
  if (!path_.empty()) RemoveCache(path_);
}

CacheFolder::CacheFolder(std::string data_folder, uint64_t max_bytes)
    : data_folder_(std::move(data_folder)), root_(CacheRoot(data_folder_)), max_bytes_(max_bytes) {}

std::string CacheFolder::PathOf(const std::string& fingerprint) const {
  return root_ + "/" + fingerprint;
}

std::string CacheFolder::IndexFolder() const { return root_ + "/index"; }

Status CacheFolder::Make() const {
  B4MRL_RETURN_IF_ERROR(MakeCacheRoot(data_folder_));
  return MakeFolderInside(IndexFolder());
}

Result<UniqueFd> CacheFolder::OpenLock(const std::string& key) const {
  const std::string folder = root_ + "/locks";
  B4MRL_RETURN_IF_ERROR(MakeFolderInside(folder));
  const std::string path = folder + "/" + key;
  // Open for writing: NFS gives exclusive locks to no other descriptors.
  UniqueFd fd(open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600));
  if (!fd.valid()) return IoError("create", path, errno);
  const mode_t mode = ModeInside(folder) & 0666;
  // EPERM is no error: another member of the group owns the file, and its mode stays.
  if (fchmod(fd.get(), mode) != 0 && errno != EPERM) return IoError("set the mode of", path, errno);
  return fd;
}

Result<UniqueFd> CacheFolder::Lock(const std::string& key,
                                   const std::atomic<bool>& cancelled) const {
  constexpr int64_t kPatienceMs = 600'000;
  constexpr int kBetweenTriesMs = 20;
  B4MRL_ASSIGN_OR_RETURN(UniqueFd fd, OpenLock(key));
  const Deadline patience = Deadline::AfterMs(kPatienceMs);
  while (flock(fd.get(), LOCK_EX | LOCK_NB) != 0) {
    if (errno == EINTR) continue;
    if (errno != EWOULDBLOCK) break;  // a file system without locks
    if (cancelled) return Cancelled();
    if (patience.expired()) {
      return Status(StatusCode::kUnavailable, "another daemon is still making it; ask again");
    }
    poll(nullptr, 0, kBetweenTriesMs);
  }
  return fd;
}

Result<ImportFolder> CacheFolder::MakeImportFolder(const std::string& key) const {
  B4MRL_ASSIGN_OR_RETURN(std::string path, MakeUnfinishedFolder(root_, key));
  return ImportFolder(std::move(path));
}

void CacheFolder::Touch(const std::string& fingerprint) const { TouchPath(PathOf(fingerprint)); }

Status CacheFolder::MakeRoom() const {
  struct Cache {
    fs::file_time_type used;
    fs::path path;
    uint64_t bytes;
  };
  std::vector<Cache> caches;
  uint64_t total = 0;
  for (const fs::path& path : EntriesOf(root_)) {
    if (!IsHash128(path.filename().string())) continue;
    std::error_code error;
    caches.push_back({fs::last_write_time(path, error), path, FolderBytes(path)});
    total += caches.back().bytes;
  }
  std::ranges::sort(caches, {}, &Cache::used);
  for (const Cache& cache : caches) {
    if (total <= max_bytes_) break;
    if (!RemoveUnusedCache(cache.path)) {
      TouchPath(cache.path);  // it counts as used: unused caches go first if its user dies
      continue;
    }
    spdlog::info("removed the cache {} to make room", cache.path.string());
    total -= cache.bytes;
  }
  if (total <= max_bytes_) return Status();
  return Status(StatusCode::kLimitExceeded,
                fmt::format("the caches in use would take {} bytes, allowed: {}; try again when "
                            "fewer datasets are in use",
                            total, max_bytes_));
}

void CacheFolder::RemoveUnfinished() const {
  for (const fs::path& path : EntriesOf(root_)) {
    const std::string name = path.filename().string();
    const std::string key(NameOfUnfinished(name));
    if (key.empty()) continue;
    const Result<UniqueFd> lock = OpenLock(key);
    if (lock.ok() && flock(lock->get(), LOCK_EX | LOCK_NB) == 0) RemoveCache(path);
  }
}

}  // namespace b4mrl
