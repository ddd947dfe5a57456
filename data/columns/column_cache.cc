#include "data/columns/column_cache.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <span>
#include <utility>

#include "proto/base/limits.h"
#include "proto/wire/json_depth.h"

namespace b4mrl {
namespace {

constexpr int kSchema = 1;
constexpr size_t kMaxManifestBytes = 1 << 20;
constexpr int kMaxManifestDepth = 4;  // lists and objects inside each other
constexpr size_t kMaxColumns = 64;
constexpr std::string_view kManifestName = "manifest.json";

using Json = nlohmann::json;

Status Damaged(const std::string& folder, std::string_view what) {
  return Status(StatusCode::kDataLoss, fmt::format("column cache {}: {}", folder, what));
}

std::string ColumnPath(const std::string& folder, std::string_view name) {
  return fmt::format("{}/{}.raw", folder, name);
}

std::string ManifestPath(const std::string& folder) {
  return fmt::format("{}/{}", folder, kManifestName);
}

std::string NameOf(const std::string& folder) { return folder.substr(folder.rfind('/') + 1); }

bool ValidColumnName(std::string_view name) {
  return !name.empty() && name.size() <= 64 && std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || c == '_';
  });
}

std::string HashText(std::string_view text) {
  StreamHash hash;
  hash.Update(std::as_bytes(std::span(text.data(), text.size())));
  return hash.Hex();
}

// The hash of a manifest, over everything in it but the hash.
std::string HashManifest(Json manifest) {
  manifest.erase("hash");
  return HashText(manifest.dump());
}

bool ReadColumn(const Json& entry, CachedColumn* column) {
  if (!entry.is_object()) return false;
  const Json name = entry.value("name", Json());
  const Json dtype = entry.value("dtype", Json());
  const Json rows = entry.value("rows", Json());
  const Json width = entry.value("width", Json());
  const Json hash = entry.value("hash", Json());
  if (!name.is_string() || !dtype.is_number_unsigned() || !rows.is_number_unsigned() ||
      !width.is_number_unsigned() || !hash.is_string()) {
    return false;
  }
  column->name = name.get<std::string>();
  column->dtype = static_cast<DType>(std::min<uint64_t>(dtype.get<uint64_t>(), 255));
  column->rows = rows.get<uint64_t>();
  column->width = width.get<uint64_t>();
  column->hash = hash.get<std::string>();
  return ValidColumnName(column->name) && DTypeSize(column->dtype) != 0 &&
         column->rows <= limits::kMaxDatasetRows &&
         column->width <= limits::kMaxObservationDimensions;
}

size_t ColumnBytes(const CachedColumn& column) {
  return column.rows * column.width * DTypeSize(column.dtype);
}

}  // namespace

Result<std::shared_ptr<const ColumnCache>> ColumnCache::Map(const std::string& folder) {
  std::shared_ptr<ColumnCache> cache(new ColumnCache());
  cache->folder_ = folder;
  B4MRL_RETURN_IF_ERROR(cache->Lock());
  B4MRL_RETURN_IF_ERROR(cache->ReadManifest());
  for (const CachedColumn& column : cache->columns_) {
    B4MRL_RETURN_IF_ERROR(cache->MapColumn(column));
  }
  return std::shared_ptr<const ColumnCache>(std::move(cache));
}

ColumnCache::~ColumnCache() {
  for (const Mapping& mapping : mappings_) {
    if (mapping.data != nullptr) munmap(mapping.data, mapping.bytes);
  }
}

Status ColumnCache::Lock() {
  const Status gone(StatusCode::kUnknownName, fmt::format("there is no column cache {}", folder_));
  const std::string path = ManifestPath(folder_);
  lock_ = UniqueFd(open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
  if (!lock_.valid()) return errno == ENOENT ? gone : IoError("open", path, errno);
  // On a file system without locks, caches are served without locks.
  if (flock(lock_.get(), LOCK_SH | LOCK_NB) != 0 && errno == EWOULDBLOCK) return gone;
  struct stat info {};
  if (fstat(lock_.get(), &info) != 0) return IoError("inspect", path, errno);
  return info.st_nlink > 0 ? Status() : gone;  // `gone` if removed between our open and our lock
}

Status ColumnCache::ReadManifest() {
  B4MRL_ASSIGN_OR_RETURN(const std::string text,
                         ReadSmallFile(ManifestPath(folder_), kMaxManifestBytes));
  const Json manifest = ParseShallow<Json>(text, kMaxManifestDepth);
  if (!manifest.is_object()) return Damaged(folder_, "its manifest is not a JSON object");
  if (manifest.value("hash", Json()) != HashManifest(manifest)) {
    return Damaged(folder_, "its manifest does not have the hash that it names");
  }
  if (manifest.value("schema", Json()) != kSchema) {
    return Status(StatusCode::kVersionMismatch,
                  fmt::format("column cache {} has another schema than {}", folder_, kSchema));
  }
  const Json columns = manifest.value("columns", Json());
  const Json properties = manifest.value("properties", Json());
  if (!columns.is_array() || columns.size() > kMaxColumns || !properties.is_object()) {
    return Damaged(folder_, "its manifest lacks columns or properties");
  }
  for (const Json& entry : columns) {
    CachedColumn column;
    if (!ReadColumn(entry, &column)) return Damaged(folder_, "a column's entry is malformed");
    columns_.push_back(std::move(column));
  }
  for (const auto& [name, value] : properties.items()) {
    if (!value.is_string()) return Damaged(folder_, "a property is not a string");
    properties_[name] = value.get<std::string>();
  }
  return Status();
}

Status ColumnCache::MapColumn(const CachedColumn& column) {
  const std::string path = ColumnPath(folder_, column.name);
  const UniqueFd fd(open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
  if (!fd.valid() && errno == ENOENT) {
    return Damaged(folder_, fmt::format("column '{}' is missing", column.name));
  }
  if (!fd.valid()) return IoError("open", path, errno);
  struct stat info {};
  if (fstat(fd.get(), &info) != 0) return IoError("inspect", path, errno);
  const size_t bytes = ColumnBytes(column);
  if (!S_ISREG(info.st_mode) || static_cast<uint64_t>(info.st_size) != bytes) {
    return Damaged(folder_, fmt::format("column '{}' has {} bytes instead of {}", column.name,
                                        info.st_size, bytes));
  }
  void* data = nullptr;
  if (bytes > 0) {
    data = mmap(nullptr, bytes, PROT_READ, MAP_SHARED, fd.get(), 0);
    if (data == MAP_FAILED) return IoError("map", path, errno);
    // Batches touch rows at random, so the kernel's read-ahead would be wasted.
    madvise(data, bytes, MADV_RANDOM);
  }
  mappings_.push_back({data, bytes});
  return Status();
}

Status ColumnCache::Verify(const std::function<bool()>& is_cancelled) const {
  constexpr size_t kBlockBytes = 16 << 20;
  for (size_t i = 0; i < columns_.size(); ++i) {
    const Mapping& mapping = mappings_[i];
    if (mapping.data != nullptr) madvise(mapping.data, mapping.bytes, MADV_SEQUENTIAL);
    StreamHash hash;
    std::span bytes(static_cast<const std::byte*>(mapping.data), mapping.bytes);
    while (!bytes.empty()) {
      if (is_cancelled()) {
        return Status(StatusCode::kUnavailable, "verifying a cache was cancelled");
      }
      const auto block = bytes.first(std::min(bytes.size(), kBlockBytes));
      hash.Update(block);
      bytes = bytes.subspan(block.size());
    }
    if (mapping.data != nullptr) madvise(mapping.data, mapping.bytes, MADV_RANDOM);
    if (hash.Hex() != columns_[i].hash) {
      return Damaged(folder_, fmt::format("column '{}' is not what was written", columns_[i].name));
    }
  }
  return Status();
}

uint64_t ColumnCache::bytes() const {
  uint64_t total = 0;
  for (const Mapping& mapping : mappings_) total += mapping.bytes;
  return total;
}

const CachedColumn* ColumnCache::Describe(std::string_view name) const {
  for (const CachedColumn& column : columns_) {
    if (column.name == name) return &column;
  }
  return nullptr;
}

Result<const std::byte*> ColumnCache::FindBytes(std::string_view name, DType dtype, uint64_t rows,
                                                uint64_t width) const {
  const CachedColumn* column = Describe(name);
  if (column == nullptr) return Damaged(folder_, fmt::format("it has no column '{}'", name));
  if (column->dtype != dtype || column->rows != rows || column->width != width) {
    return Damaged(folder_, fmt::format("column '{}' is {} x {} {}, not {} x {} {}", name,
                                        column->rows, column->width, DTypeName(column->dtype), rows,
                                        width, DTypeName(dtype)));
  }
  const auto index = static_cast<size_t>(column - columns_.data());
  return static_cast<const std::byte*>(mappings_[index].data);
}

ColumnCacheWriter::ColumnCacheWriter(std::string folder, std::string temporary, mode_t file_mode)
    : folder_(std::move(folder)), temporary_(std::move(temporary)), file_mode_(file_mode) {}

ColumnCacheWriter::ColumnCacheWriter(ColumnCacheWriter&& other) noexcept
    : folder_(std::move(other.folder_)),
      temporary_(std::exchange(other.temporary_, std::string())),
      file_mode_(other.file_mode_),
      columns_(std::move(other.columns_)),
      properties_(std::move(other.properties_)) {}

ColumnCacheWriter::~ColumnCacheWriter() {
  if (!temporary_.empty()) RemoveCache(temporary_);
}

Result<ColumnCacheWriter> ColumnCacheWriter::Create(const std::string& folder) {
  B4MRL_ASSIGN_OR_RETURN(std::string temporary,
                         MakeUnfinishedFolder(FolderOf(folder), NameOf(folder)));
  return ColumnCacheWriter(folder, std::move(temporary), ModeInside(FolderOf(folder)) & 0666);
}

Result<size_t> ColumnCacheWriter::AddColumn(std::string_view name, DType dtype, uint64_t width) {
  if (!ValidColumnName(name) || DTypeSize(dtype) == 0 || width == 0) {
    return InvalidArgument("column", name, "[a-z_]+ with a known dtype and width above 0");
  }
  const std::string path = ColumnPath(temporary_, name);
  Column column;
  column.description = {std::string(name), dtype, 0, width, ""};
  column.fd = UniqueFd(open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, file_mode_));
  if (!column.fd.valid()) return IoError("create", path, errno);
  if (fchmod(column.fd.get(), file_mode_) != 0) return IoError("set the mode of", path, errno);
  columns_.push_back(std::move(column));
  return columns_.size() - 1;
}

Status ColumnCacheWriter::Append(size_t index, std::span<const std::byte> whole_rows) {
  Column& column = columns_[index];
  const size_t row_bytes = column.description.width * DTypeSize(column.description.dtype);
  if (whole_rows.size() % row_bytes != 0) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("column '{}' takes whole rows of {} bytes, not {} bytes",
                              column.description.name, row_bytes, whole_rows.size()));
  }
  B4MRL_RETURN_IF_ERROR(
      WriteFully(column.fd.get(), whole_rows, ColumnPath(folder_, column.description.name)));
  column.hash.Update(whole_rows);
  column.description.rows += whole_rows.size() / row_bytes;
  return Status();
}

void ColumnCacheWriter::SetProperty(std::string_view name, std::string_view value) {
  properties_[std::string(name)] = std::string(value);
}

Status ColumnCacheWriter::WriteManifest() {
  Json manifest;
  manifest["schema"] = kSchema;
  manifest["properties"] = Json::object();
  for (const auto& [name, value] : properties_) manifest["properties"][name] = value;
  manifest["columns"] = Json::array();
  for (const Column& column : columns_) {
    const CachedColumn& d = column.description;
    manifest["columns"].push_back({{"name", d.name},
                                   {"dtype", static_cast<uint64_t>(d.dtype)},
                                   {"rows", d.rows},
                                   {"width", d.width},
                                   {"hash", column.hash.Hex()}});
  }
  // Text from a file's metadata need not be UTF-8, but JSON must be.
  const auto replace = Json::error_handler_t::replace;
  manifest = Json::parse(manifest.dump(-1, ' ', false, replace), nullptr, false);
  manifest["hash"] = HashManifest(manifest);
  return WriteSmallFile(ManifestPath(temporary_), manifest.dump(1) + "\n", file_mode_);
}

Status ColumnCacheWriter::Commit() {
  // Column files are not fsynced: mapping and Verify check their sizes and hashes, and a damaged
  // cache can be made again.
  B4MRL_RETURN_IF_ERROR(WriteManifest());
  return PlaceCache(temporary_, folder_);  // the destructor removes ours if a cache was there
}

Status PlaceCache(const std::string& made, const std::string& folder) {
  if (rename(made.c_str(), folder.c_str()) == 0) return SyncFolder(FolderOf(folder));
  if (errno != ENOTEMPTY && errno != EEXIST) return IoError("create folder", folder, errno);
  if (access(ManifestPath(folder).c_str(), F_OK) == 0) return Status();
  RemoveCache(folder);  // the cache there has no manifest: a part of it was deleted
  if (rename(made.c_str(), folder.c_str()) != 0) return IoError("create folder", folder, errno);
  return SyncFolder(FolderOf(folder));
}

Result<std::string> MakeUnfinishedFolder(const std::string& parent, std::string_view name) {
  std::string path = fmt::format("{}/{}{}-XXXXXX", parent, kUnfinishedCachePrefix, name);
  if (mkdtemp(path.data()) == nullptr) return IoError("create folder", path, errno);
  if (chmod(path.c_str(), ModeInside(parent)) == 0) return path;
  const Status status = IoError("set the mode of", path, errno);
  rmdir(path.c_str());
  return status;
}

std::string_view NameOfUnfinished(std::string_view folder) {
  if (!folder.starts_with(kUnfinishedCachePrefix)) return "";
  folder.remove_prefix(kUnfinishedCachePrefix.size());
  return folder.substr(0, folder.rfind('-'));
}

void RemoveCache(const std::string& folder) {
  std::error_code ignored;
  std::string leaving = folder;
  if (!NameOf(folder).starts_with(kUnfinishedCachePrefix)) {
    const Result<std::string> empty = MakeUnfinishedFolder(FolderOf(folder), NameOf(folder));
    // The rename replaces the empty folder.
    if (empty.ok() && rename(folder.c_str(), empty->c_str()) == 0) leaving = *empty;
    if (empty.ok() && leaving == folder) rmdir(empty->c_str());
  }
  std::filesystem::remove_all(leaving, ignored);
}

bool RemoveUnusedCache(const std::string& folder) {
  // Open for writing: NFS gives exclusive locks to no other descriptors.
  const UniqueFd manifest(open(ManifestPath(folder).c_str(), O_RDWR | O_CLOEXEC | O_NONBLOCK));
  if (!manifest.valid() && errno != ENOENT) return false;
  const bool in_use =
      manifest.valid() && flock(manifest.get(), LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
  if (!in_use) RemoveCache(folder);
  return !in_use;
}

}  // namespace b4mrl
