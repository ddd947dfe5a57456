#include "server/datasets/cache_folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <spdlog/spdlog.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

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

// On disk, a cache's files take that much more than its columns' bytes at most.
constexpr uint64_t kDiskSlackBytes = 2 << 20;

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

struct Cache {
  fs::file_time_type used;
  fs::path path;
  uint64_t bytes;
};

// The caches of a folder, those that were used longest ago first.
std::vector<Cache> CachesByUse(const fs::path& folder) {
  std::vector<Cache> caches;
  for (const fs::path& path : EntriesOf(folder)) {
    if (!IsHash128(path.filename().string())) continue;
    std::error_code error;
    caches.push_back({fs::last_write_time(path, error), path, FolderBytes(path)});
  }
  std::ranges::sort(caches, {}, &Cache::used);
  return caches;
}

// A lock's file is removed by who holds the lock. Others may have opened it before, and then get a
// lock that nobody else looks at. On a host that has the folder by NFS, the file may seem to be
// there for a while, so it also gets a byte, which is seen as soon as the lock is had.
bool IsInForce(int fd, const std::string& path) {
  struct stat info {};
  return StillNamed(fd, path) && fstat(fd, &info) == 0 && info.st_size == 0;
}

void MarkAsRemoved(int fd) { [[maybe_unused]] const int failed = ftruncate(fd, 1); }

// Whether the cache was unused and is removed.
bool RemoveToMakeRoom(const Cache& cache) {
  if (!RemoveUnusedCache(cache.path)) {
    TouchPath(cache.path);  // it counts as used: unused caches go first if its user dies
    return false;
  }
  spdlog::info("removed the cache {} to make room", cache.path.string());
  return true;
}

}  // namespace

ImportFolder::~ImportFolder() {
  if (!path_.empty()) RemoveCache(path_);
}

CacheFolder::CacheFolder(std::string data_folder, uint64_t max_bytes, size_t max_caches)
    : data_folder_(std::move(data_folder)),
      root_(CacheRoot(data_folder_)),
      max_bytes_(max_bytes),
      max_caches_(max_caches) {}

std::string CacheFolder::PathOf(const std::string& fingerprint) const {
  return root_ + "/" + fingerprint;
}

std::string CacheFolder::IndexFolder() const { return root_ + "/index"; }

std::string CacheFolder::LocksFolder() const { return root_ + "/locks"; }

Status CacheFolder::Make() const {
  B4MRL_RETURN_IF_ERROR(MakeCacheRoot(data_folder_));
  return MakeFolderInside(IndexFolder());
}

Result<UniqueFd> CacheFolder::TryLock(const std::string& key) const {
  const std::string folder = LocksFolder();
  B4MRL_RETURN_IF_ERROR(MakeFolderInside(folder));
  const std::string path = folder + "/" + key;
  // Open for writing: NFS gives exclusive locks to no other descriptors.
  UniqueFd fd(open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600));
  if (!fd.valid()) return IoError("create", path, errno);
  const mode_t mode = ModeInside(folder) & 0666;
  // EPERM is no error: another member of the group owns the file, and its mode stays.
  if (fchmod(fd.get(), mode) != 0 && errno != EPERM) return IoError("set the mode of", path, errno);
  if (flock(fd.get(), LOCK_EX | LOCK_NB) == 0) {
    if (IsInForce(fd.get(), path)) return fd;
  } else if (errno != EWOULDBLOCK && errno != EINTR) {
    return Status(StatusCode::kUnsupported, path + " is on a file system without locks");
  }
  return Status(StatusCode::kBusy, "another daemon is still making it; ask again");
}

Result<UniqueFd> CacheFolder::Lock(const std::string& key,
                                   const std::atomic<bool>& cancelled) const {
  constexpr int64_t kPatienceMs = 600'000;
  constexpr int kBetweenTriesMs = 20;
  const Deadline patience = Deadline::AfterMs(kPatienceMs);
  while (true) {
    Result<UniqueFd> lock = TryLock(key);
    const StatusCode code = lock.status().code();
    if (code == StatusCode::kUnsupported) return UniqueFd();
    if (code != StatusCode::kBusy) return lock;
    if (cancelled) return Cancelled();
    if (patience.expired()) return Status(StatusCode::kUnavailable, lock.status().message());
    poll(nullptr, 0, kBetweenTriesMs);
  }
}

Result<ImportFolder> CacheFolder::MakeImportFolder(const std::string& key) const {
  B4MRL_ASSIGN_OR_RETURN(std::string path, MakeUnfinishedFolder(root_, key));
  return ImportFolder(std::move(path));
}

void CacheFolder::Touch(const std::string& fingerprint) const { TouchPath(PathOf(fingerprint)); }

Status CacheFolder::MakeRoom() const {
  const std::vector<Cache> caches = CachesByUse(root_);
  uint64_t total = 0;
  for (const Cache& cache : caches) total += cache.bytes;
  size_t count = caches.size();
  for (const Cache& cache : caches) {
    if (total <= max_bytes_ && count <= max_caches_) break;
    if (!RemoveToMakeRoom(cache)) continue;
    total -= cache.bytes;
    --count;
  }
  if (total <= max_bytes_) return Status();
  return Status(StatusCode::kLimitExceeded,
                fmt::format("the caches in use would take {} bytes, allowed: {}; try again when "
                            "fewer datasets are in use",
                            total, max_bytes_));
}

bool CacheFolder::MakeRoomOnDisk(uint64_t bytes, const Status& failure) const {
  const bool by_quota = IsIoErrorOf(failure, EDQUOT);
  // Caches that others may want again are given up for nothing but a full disk or quota.
  if (!by_quota && !IsIoErrorOf(failure, ENOSPC)) return false;
  bool removed = false;
  uint64_t removed_bytes = 0;
  const auto has_room = [&] {
    std::error_code error;
    const uint64_t room = by_quota ? removed_bytes : fs::space(root_, error).available;
    // Halves, as `bytes` may be any number.
    return error || room / 2 >= bytes / 2 + kDiskSlackBytes / 2;
  };
  for (const Cache& cache : CachesByUse(root_)) {
    if (has_room()) break;
    if (!RemoveToMakeRoom(cache)) continue;
    removed = true;
    removed_bytes += cache.bytes;
  }
  return removed;
}

void CacheFolder::RemoveLeftovers() const {
  for (const fs::path& path : EntriesOf(root_)) {
    const std::string name = path.filename().string();
    const std::string key(NameOfUnfinished(name));
    if (key.empty()) continue;
    const Result<UniqueFd> lock = TryLock(key);
    if (lock.ok()) RemoveCache(path);
  }
  for (const fs::path& path : EntriesOf(LocksFolder())) {
    const Result<UniqueFd> lock = TryLock(path.filename().string());
    if (lock.ok() && unlink(path.c_str()) == 0) MarkAsRemoved(lock->get());
  }
}

}  // namespace b4mrl
