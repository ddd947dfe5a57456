// Which caches make room, in number and on the disk, and whose a lock is.
#include "server/datasets/cache_folder.h"

#include <atomic>
#include <catch2/catch.hpp>
#include <cerrno>
#include <chrono>
#include <filesystem>
#include <string>
#include <vector>

#include "data/columns/column_cache.h"
#include "tests/data/temporary_folder.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

// Five caches of a MiB and a manifest each; the first was used longest ago.
struct Caches {
  TemporaryFolder folder;
  std::vector<std::string> paths;

  Caches() {
    RequireOk(CacheFolder(folder.path(), 1).Make());
    const auto now = fs::file_time_type::clock::now();
    const std::vector<float> rewards((1 << 20) / sizeof(float), 1.0f);
    for (int i = 0; i < 5; ++i) {
      paths.push_back(folder.File(".b4mrl-cache/" + std::string(32, static_cast<char>('a' + i))));
      ColumnCacheWriter writer = Take(ColumnCacheWriter::Create(paths.back()));
      Take(writer.AddColumn("rewards", DType::kFloat32, 1));
      RequireOk(writer.Append(0, std::span<const float>(rewards)));
      RequireOk(writer.Commit());
    }
    for (int i = 0; i < 5; ++i) fs::last_write_time(paths[i], now - std::chrono::hours(9 - i));
  }
  // Which of them are left, as "01234".
  std::string Left() const {
    std::string left;
    for (size_t i = 0; i < paths.size(); ++i) {
      if (fs::exists(paths[i])) left += static_cast<char>('0' + i);
    }
    return left;
  }
};

TEST_CASE("a limited number of caches is kept, those that were used last") {
  const Caches caches;
  RequireOk(CacheFolder(caches.folder.path(), 1ull << 30, 3).MakeRoom());
  CHECK(caches.Left() == "234");
  RequireOk(CacheFolder(caches.folder.path(), 1ull << 30, 3).MakeRoom());
  CHECK(caches.Left() == "234");
}

TEST_CASE("caches in use stay, however many they are") {
  const Caches caches;
  const auto used = Take(ColumnCache::Map(caches.paths[0]));
  const auto used_too = Take(ColumnCache::Map(caches.paths[1]));
  RequireOk(CacheFolder(caches.folder.path(), 1ull << 30, 1).MakeRoom());
  CHECK(caches.Left() == "01");
}

TEST_CASE("on a full disk the caches that nobody uses are given up") {
  const Caches caches;
  const auto used = Take(ColumnCache::Map(caches.paths[1]));
  const CacheFolder folder(caches.folder.path(), 1ull << 30);
  const Status full = IoError("write", "cache", ENOSPC);
  CHECK_FALSE(folder.MakeRoomOnDisk(0, full));
  CHECK(caches.Left() == "01234");
  // No disk has so much room, so this one counts as full.
  CHECK(folder.MakeRoomOnDisk(UINT64_MAX, full));
  CHECK(caches.Left() == "1");
  CHECK_FALSE(folder.MakeRoomOnDisk(UINT64_MAX, full));
}

TEST_CASE("for a full quota, as much is given up as is to be written, though the disk has room") {
  const Caches caches;
  const auto used = Take(ColumnCache::Map(caches.paths[0]));
  const CacheFolder folder(caches.folder.path(), 1ull << 30);
  // As an importer's answer brings it. What a cache takes beside its columns is two of the caches.
  const Status full = IoError("write", "cache", EDQUOT).WithContext("HalfCheetah/medium.h5");
  CHECK(folder.MakeRoomOnDisk(0, full));
  CHECK(caches.Left() == "034");
  CHECK(folder.MakeRoomOnDisk(UINT64_MAX, full));
  CHECK(caches.Left() == "0");
  CHECK_FALSE(folder.MakeRoomOnDisk(UINT64_MAX, full));
}

TEST_CASE("no cache is given up for an error that room does not mend") {
  const Caches caches;
  const CacheFolder folder(caches.folder.path(), 1ull << 30);
  CHECK_FALSE(folder.MakeRoomOnDisk(UINT64_MAX, IoError("open", "x.h5", EACCES)));
  CHECK_FALSE(folder.MakeRoomOnDisk(UINT64_MAX, IoError("write", "cache", EFBIG)));
  const std::string text = IoError("write", "cache", ENOSPC).message();
  CHECK_FALSE(folder.MakeRoomOnDisk(UINT64_MAX, Status(StatusCode::kDataLoss, text)));
  CHECK(caches.Left() == "01234");
}

TEST_CASE("a lock whose file was removed is not had by who had opened the file before") {
  const TemporaryFolder folder;
  const CacheFolder cache(folder.path(), 1);
  RequireOk(cache.Make());
  const std::atomic<bool> cancelled{true};  // nobody waits
  Take(cache.Lock("aa", cancelled));
  // As a host sees it that has the folder by NFS, and for which the removed file still has its
  // name.
  WriteBytes(folder.File(".b4mrl-cache/locks/aa"), "-");
  CHECK(cache.Lock("aa", cancelled).status().code() == StatusCode::kUnavailable);
  cache.RemoveLeftovers();
  CHECK(fs::exists(folder.File(".b4mrl-cache/locks/aa")));  // whose it may be
  fs::remove(folder.File(".b4mrl-cache/locks/aa"));
  CHECK(cache.Lock("aa", cancelled).ok());
}

}  // namespace
}  // namespace b4mrl
