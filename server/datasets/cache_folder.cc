#include "server/datasets/cache_folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <spdlog/spdlog.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <charconv>
#include <filesystem>
#include <vector>

#include "data/columns/column_cache.h"
#include "data/files/cache_root.h"
#include "data/files/file_hash.h"
#include "data/files/stored_bytes.h"
#include "proto/base/unique_fd.h"

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

Result<ImportFolder> CacheFolder::MakeImportFolder() const {
  static std::atomic<uint64_t> counter{0};
  const std::string path = fmt::format("{}/{}{}-import-{}", root_, kUnfinishedCachePrefix, getpid(),
                                       counter.fetch_add(1));
  RemoveCache(path);  // left by a killed process that had our id
  B4MRL_RETURN_IF_ERROR(MakeFolderInside(path));
  return ImportFolder(path);
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
    if (!name.starts_with(kUnfinishedCachePrefix)) continue;
    pid_t writer = 0;
    const char* digits = name.data() + kUnfinishedCachePrefix.size();
    std::from_chars(digits, name.data() + name.size(), writer);
    if (writer <= 0 || (kill(writer, 0) != 0 && errno == ESRCH)) RemoveCache(path);
  }
}

}  // namespace b4mrl
