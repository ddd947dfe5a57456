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

// Whether the cache was unused and is removed. Its lock file stays: who waits for it holds the file
// open, and would not wait for the next one that opens the path.
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
  const bool by_quota = IsQuotaError(failure);
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
