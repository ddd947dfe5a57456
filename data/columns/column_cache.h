// A folder with one raw file per column and a manifest, from which datasets are served.
//
//   <folder>/manifest.json   schema, properties, and each column's name, dtype, rows, width, hash
//   <folder>/<column>.raw    rows x width elements, row-major, little-endian, nothing else
//
// The folder appears complete or not at all: it is made under a temporary name and renamed. The
// folder and its files get the permissions of the folder around them, whatever the umask. Mapping
// checks the manifest's own hash and the size of every file; Verify compares every column with its
// XXH3 hash. RemoveUnusedCache, in any process, does not remove a mapped cache. Thread rule: a
// ColumnCache is immutable and may be read by any thread; a writer belongs to one thread. Errors:
// kUnknownName (the folder holds no cache), kIoError, kDataLoss (damaged), kVersionMismatch
// (another schema).
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "data/files/atomic_file.h"
#include "data/files/file_hash.h"
#include "proto/base/status.h"
#include "proto/base/unique_fd.h"
#include "proto/wire/tensor.h"

namespace b4mrl {

struct CachedColumn {
  std::string name;
  DType dtype = DType::kUnspecified;
  uint64_t rows = 0;
  uint64_t width = 0;  // elements of a row
  std::string hash;    // XXH3-128 of the file
};

// Short strings that travel with the columns: source hash, rule, corruptions, statistics.
using CacheProperties = std::map<std::string, std::string, std::less<>>;

class ColumnCache {
 public:
  // Maps every column. The bytes stay valid while this object lives, even when the folder is
  // removed.
  static Result<std::shared_ptr<const ColumnCache>> Map(const std::string& folder);
  ~ColumnCache();
  ColumnCache(const ColumnCache&) = delete;
  ColumnCache& operator=(const ColumnCache&) = delete;

  // Reads all columns once: kDataLoss when the bytes of a column are not those that were written.
  // kUnavailable soon after `is_cancelled` returned true.
  Status Verify(const std::function<bool()>& is_cancelled) const;

  const CacheProperties& properties() const { return properties_; }
  uint64_t bytes() const;  // size of all columns
  // The elements of the column `name`. kDataLoss if the cache lacks this column, or if its element
  // type, rows or width differ from those asked for.
  template <typename T>
  Result<std::span<const T>> Find(std::string_view name, uint64_t rows, uint64_t width) const {
    B4MRL_ASSIGN_OR_RETURN(const std::byte* data, FindBytes(name, DTypeOf<T>(), rows, width));
    return std::span<const T>(reinterpret_cast<const T*>(data), rows * width);
  }
  const CachedColumn* Describe(std::string_view name) const;

 private:
  struct Mapping {
    void* data = nullptr;  // null for an empty column
    size_t bytes = 0;
  };
  ColumnCache() = default;
  Status Lock();
  Status ReadManifest();
  Status MapColumn(const CachedColumn& column);
  Result<const std::byte*> FindBytes(std::string_view name, DType dtype, uint64_t rows,
                                     uint64_t width) const;

  std::string folder_;
  CacheProperties properties_;
  std::vector<CachedColumn> columns_;
  std::vector<Mapping> mappings_;  // one per column
  UniqueFd lock_;                  // holds a shared lock of the manifest
};

class ColumnCacheWriter {
 public:
  // Writes into a temporary folder beside `folder`, whose parent folder must exist.
  static Result<ColumnCacheWriter> Create(const std::string& folder);
  ColumnCacheWriter(ColumnCacheWriter&&) noexcept;
  ColumnCacheWriter& operator=(ColumnCacheWriter&&) = delete;
  ~ColumnCacheWriter();  // removes the temporary folder unless it was committed

  // Adds a column, whose name matches [a-z_]+. A column is written from its start to its end;
  // several columns may be open.
  Result<size_t> AddColumn(std::string_view name, DType dtype, uint64_t width);
  Status Append(size_t column, std::span<const std::byte> whole_rows);
  template <typename T>
  Status Append(size_t column, std::span<const T> values) {
    return Append(column, std::as_bytes(values));
  }
  void SetProperty(std::string_view name, std::string_view value);
  // Renames the folder into place. If another process has made the same cache meanwhile, the other
  // process's cache stays.
  Status Commit();

 private:
  struct Column {
    CachedColumn description;
    UniqueFd fd;
    StreamHash hash;
  };
  ColumnCacheWriter(std::string folder, std::string temporary, mode_t file_mode);
  Status WriteManifest();

  std::string folder_;
  std::string temporary_;
  mode_t file_mode_;
  std::vector<Column> columns_;
  CacheProperties properties_;
};

// Renames the finished cache `made` to `folder`. If a cache of that name exists already, both stay.
Status PlaceCache(const std::string& made, const std::string& folder);
// Removes a cache folder if it exists. Other processes see the cache whole or not at all; processes
// that have the cache mapped can still read it.
void RemoveCache(const std::string& folder);
// Removes the cache unless a process has it mapped. Returns whether it was removed.
bool RemoveUnusedCache(const std::string& folder);

// Folders that are being written or removed: "unfinished-<name>-<random characters>", where <name>
// is that of the finished folder, or of the work. No two processes, on any host, share one.
inline constexpr std::string_view kUnfinishedCachePrefix = "unfinished-";
// Makes such a folder in `parent`, with the permissions of `parent`. kIoError.
Result<std::string> MakeUnfinishedFolder(const std::string& parent, std::string_view name);
// <name>, of the name of such a folder; "" for any other folder.
std::string_view NameOfUnfinished(std::string_view folder);

}  // namespace b4mrl
