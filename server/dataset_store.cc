#include "server/dataset_store.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <spdlog/spdlog.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "data/atomic_file.h"
#include "data/file_hash.h"
#include "proto/base/limits.h"
#include "server/corruption.h"
#include "server/import_dataset.h"
#include "server/importer.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr size_t kMaxIndexBytes = 64 * 1024;
constexpr int64_t kMinImportMs = 60'000;
constexpr uint64_t kImportBytesPerMs = 4 * 1024;

bool IsFingerprint(const std::string& text) {
  return text.size() == 32 && text.find_first_not_of("0123456789abcdef") == std::string::npos;
}

// Names travel in messages, whose strings must be UTF-8, and are typed by people.
bool IsPlainName(std::string_view name) {
  return std::ranges::all_of(name, [](char c) { return c > ' ' && c <= '~'; });
}

// The extension that a dataset file has in a folder of DATA.
std::string_view ExtensionIn(const std::string& folder) {
  return folder == "d4rl" ? ".hdf5" : ".h5";
}

uint64_t FolderBytes(const fs::path& folder) {
  uint64_t total = 0;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    const uint64_t size = entry.file_size(error);
    if (!error) total += size;
  }
  return total;
}

// The time stamp of a cache folder is when it was last opened.
void Touch(const std::string& folder) { utimensat(AT_FDCWD, folder.c_str(), nullptr, 0); }

int64_t Nanoseconds(const timespec& time) { return time.tv_sec * 1'000'000'000 + time.tv_nsec; }

std::string StringOf(const Json& object, const char* name) {
  const auto found = object.find(name);
  return found != object.end() && found->is_string() ? found->get<std::string>() : "";
}

uint64_t NumberOf(const Json& object, const char* name) {
  const auto found = object.find(name);
  return found != object.end() && found->is_number_unsigned() ? found->get<uint64_t>() : 0;
}

// In blocks, because a builder holds one block in memory.
Status AppendUnderD4rl(const TransitionColumns& all, DatasetBuilder* builder) {
  constexpr uint64_t kBlockRows = 65536;
  builder->AddRewards(all.rewards, all.terminals, all.timeouts);
  for (uint64_t first = 0; first < all.rows; first += kBlockRows) {
    const uint64_t rows = std::min(kBlockRows, all.rows - first);
    const uint64_t end = first + rows;
    const size_t size = all.observation_size;
    TransitionColumns block;
    block.rows = rows;
    block.observations = all.observations.subspan(first * size, rows * size);
    block.actions = all.actions.subspan(first * all.action_size, rows * all.action_size);
    block.rewards = all.rewards.subspan(first, rows);
    const auto following =
        end < all.rows ? all.observations.subspan(end * size, size) : std::span<const float>();
    B4MRL_RETURN_IF_ERROR(
        builder->AppendD4rl(block, first, all.terminals, all.timeouts, following));
  }
  return Status();
}

// Of a cache's files. A passing shortage of memory or descriptors says nothing about them.
bool IsDamage(const Status& status) {
  return status.code() == StatusCode::kDataLoss || status.code() == StatusCode::kVersionMismatch;
}

// Whether a dataset that was loaded with `status` is to be imported or derived: it was not there,
// or not usable.
bool IsToBeMade(const Status& status) {
  return status.code() == StatusCode::kUnknownName || IsDamage(status);
}

}  // namespace

struct DatasetStore::IndexEntry {
  uint64_t file_bytes = 0;
  uint64_t modified_ns = 0;
  uint64_t inode = 0;
  std::string sha256;
  std::string fingerprint;
  std::string behaviour_policy;
  uint64_t rows = 0;

  static Result<IndexEntry> Of(const std::string& path) {
    struct stat info {};
    if (stat(path.c_str(), &info) != 0) return IoError("inspect", path, errno);
    IndexEntry entry;
    entry.file_bytes = static_cast<uint64_t>(info.st_size);
    entry.modified_ns = static_cast<uint64_t>(Nanoseconds(info.st_mtim));
    entry.inode = info.st_ino;
    return entry;
  }
  bool SameFile(const IndexEntry& other) const {
    return file_bytes == other.file_bytes && modified_ns == other.modified_ns &&
           inode == other.inode;
  }
};

std::string DatasetStore::CacheFolder(const std::string& fingerprint) const {
  return CacheRoot() + "/" + fingerprint;
}

std::string DatasetStore::IndexPath(const std::string& name) const {
  return fmt::format("{}/index/{}.json", CacheRoot(), Sha256OfText(name).substr(0, 32));
}

Result<std::vector<DatasetStore::File>> DatasetStore::FindFiles() const {
  std::vector<File> files;
  std::error_code error;
  fs::directory_iterator folders(options_.data_folder, error);
  if (error) return IoError("open data folder", options_.data_folder, error.value());
  for (; folders != fs::directory_iterator(); folders.increment(error)) {
    const std::string folder = folders->path().filename().string();
    std::error_code ignored;
    if (folder.starts_with('.') || !folders->is_directory(ignored)) continue;
    fs::directory_iterator entries(folders->path(), ignored);
    for (; !ignored && entries != fs::directory_iterator(); entries.increment(ignored)) {
      const fs::path& path = entries->path();
      if (path.extension() != ExtensionIn(folder)) continue;
      std::string name = folder + "/" + path.stem().string();
      if (!IsPlainName(name)) continue;
      files.push_back({std::move(name), path.string()});
      if (files.size() > limits::kMaxDatasets) {
        return Status(StatusCode::kLimitExceeded,
                      fmt::format("{} has more than {} datasets", options_.data_folder,
                                  limits::kMaxDatasets));
      }
    }
  }
  if (error) return IoError("read data folder", options_.data_folder, error.value());
  std::ranges::sort(files, {}, &File::name);
  return files;
}

Result<DatasetStore::File> DatasetStore::FindFile(const std::string& name) const {
  B4MRL_ASSIGN_OR_RETURN(const std::vector<File> files, FindFiles());
  std::vector<std::string> names;
  for (const File& file : files) {
    if (file.name == name) return file;
    names.push_back(file.name);
  }
  return UnknownName("dataset", name, names);
}

std::optional<DatasetStore::IndexEntry> DatasetStore::ReadIndex(const File& file) const {
  Result<IndexEntry> current = IndexEntry::Of(file.path);
  const Result<std::string> text = ReadSmallFile(IndexPath(file.name), kMaxIndexBytes);
  if (!current.ok() || !text.ok()) return std::nullopt;
  const Json json = Json::parse(*text, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object()) return std::nullopt;
  IndexEntry entry;
  entry.file_bytes = NumberOf(json, "file_bytes");
  entry.modified_ns = NumberOf(json, "modified_ns");
  entry.inode = NumberOf(json, "inode");
  entry.sha256 = StringOf(json, "sha256");
  entry.fingerprint = StringOf(json, "fingerprint");
  entry.behaviour_policy = StringOf(json, "behaviour_policy");
  entry.rows = NumberOf(json, "rows");
  if (!entry.SameFile(*current) || !IsFingerprint(entry.fingerprint)) return std::nullopt;
  return entry;
}

Status DatasetStore::WriteIndex(const File& file, const IndexEntry& entry) const {
  const Json json = {{"name", file.name},
                     {"file_bytes", entry.file_bytes},
                     {"modified_ns", entry.modified_ns},
                     {"inode", entry.inode},
                     {"sha256", entry.sha256},
                     {"fingerprint", entry.fingerprint},
                     {"behaviour_policy", entry.behaviour_policy},
                     {"rows", entry.rows}};
  return WriteSmallFile(IndexPath(file.name),
                        json.dump(1, ' ', false, Json::error_handler_t::replace));
}

Result<std::vector<DatasetFileInfo>> DatasetStore::List() const {
  B4MRL_ASSIGN_OR_RETURN(const std::vector<File> files, FindFiles());
  std::vector<DatasetFileInfo> list;
  for (const File& file : files) {
    DatasetFileInfo info;
    info.name = file.name;
    if (const std::optional<IndexEntry> entry = ReadIndex(file)) {
      info.rows = entry->rows;
      info.sha256 = entry->sha256;
      info.behaviour_policy = entry->behaviour_policy;
    }
    const Result<IndexEntry> current = IndexEntry::Of(file.path);
    if (!current.ok()) continue;  // removed meanwhile
    info.file_bytes = current->file_bytes;
    list.push_back(std::move(info));
  }
  return list;
}

Result<DatasetStore::IndexEntry> DatasetStore::Import(const File& file) {
  B4MRL_ASSIGN_OR_RETURN(IndexEntry entry, IndexEntry::Of(file.path));
  std::error_code error;
  fs::create_directories(CacheRoot() + "/index", error);
  if (error) return IoError("create cache folder", CacheRoot(), error.value());
  MakeRoom(entry.file_bytes);
  const Deadline deadline =
      Deadline::AfterMs(kMinImportMs + static_cast<int64_t>(entry.file_bytes / kImportBytesPerMs));
  spdlog::info("importing {} ({} bytes)", file.path, entry.file_bytes);
  const Result<ImportResult> imported = ImportInChild(
      options_.importer_program, {file.path, CacheRoot()}, deadline, options_.cancelled);
  if (imported.status().code() == StatusCode::kDeadlineExceeded) {
    // Not the client's deadline: asking again would not help.
    return Status(StatusCode::kDataLoss, imported.status().message());
  }
  if (!imported.ok()) return imported.status();
  entry.sha256 = imported->sha256;
  entry.fingerprint = imported->fingerprint;
  entry.rows = imported->rows;
  return entry;
}

Result<std::shared_ptr<const Dataset>> DatasetStore::OpenSource(const File& file,
                                                                IfMissing if_missing,
                                                                IndexEntry* entry) {
  if (const std::optional<IndexEntry> known = ReadIndex(file)) {
    Result<std::shared_ptr<const Dataset>> dataset = Load(known->fingerprint);
    *entry = *known;
    if (!IsToBeMade(dataset.status())) return dataset;
  }
  if (if_missing == IfMissing::kGiveNull) return std::shared_ptr<const Dataset>();
  B4MRL_ASSIGN_OR_RETURN(*entry, Import(file));
  B4MRL_ASSIGN_OR_RETURN(std::shared_ptr<const Dataset> dataset, Load(entry->fingerprint));
  entry->behaviour_policy = dataset->property("behaviour_policy");
  B4MRL_RETURN_IF_ERROR(WriteIndex(file, *entry));
  return dataset;
}

Result<std::shared_ptr<const Dataset>> DatasetStore::Load(const std::string& fingerprint) {
  if (!IsFingerprint(fingerprint)) {
    return Status(StatusCode::kUnknownName, "a fingerprint is 32 hexadecimal digits");
  }
  const Status unknown(
      StatusCode::kUnknownName,
      fmt::format("no dataset has the fingerprint {}; open it again", fingerprint));
  {
    const std::lock_guard lock(mutex_);
    if (std::shared_ptr<const Dataset> mapped = mapped_[fingerprint].lock()) return mapped;
    mapped_.erase(fingerprint);
  }
  const std::string folder = CacheFolder(fingerprint);
  std::error_code error;
  if (!fs::exists(folder, error)) return unknown;
  Result<std::shared_ptr<const Dataset>> dataset = Dataset::Open(folder);
  const Status status = dataset.ok() ? (*dataset)->cache().Verify() : dataset.status();
  if (IsDamage(status)) {
    spdlog::error("removing a damaged cache: {}", status.ToString());
    RemoveCache(folder);
  }
  if (!status.ok()) return status;
  Touch(folder);
  const std::lock_guard lock(mutex_);
  mapped_[fingerprint] = *dataset;
  return dataset;
}

Result<std::shared_ptr<const Dataset>> DatasetStore::LoadOrDerive(
    const std::string& fingerprint, const Dataset& source, IfMissing if_missing,
    const std::function<Status(DatasetBuilder*)>& derive) {
  Result<std::shared_ptr<const Dataset>> cached = Load(fingerprint);
  if (!IsToBeMade(cached.status())) return cached;
  if (if_missing == IfMissing::kGiveNull) return std::shared_ptr<const Dataset>();
  MakeRoom(source.cache().bytes());
  B4MRL_ASSIGN_OR_RETURN(
      DatasetBuilder builder,
      DatasetBuilder::Create(CacheFolder(fingerprint), source.columns().observation_size,
                             source.columns().action_size));
  for (const auto& [name, value] : source.cache().properties()) builder.SetProperty(name, value);
  B4MRL_RETURN_IF_ERROR(derive(&builder));
  B4MRL_RETURN_IF_ERROR(builder.Commit());
  return Load(fingerprint);
}

Result<OpenedDataset> DatasetStore::Open(const DatasetRequest& request, IfMissing if_missing) {
  B4MRL_ASSIGN_OR_RETURN(const File file, FindFile(request.name));
  IndexEntry entry;
  B4MRL_ASSIGN_OR_RETURN(std::shared_ptr<const Dataset> dataset,
                         OpenSource(file, if_missing, &entry));
  if (dataset == nullptr) return OpenedDataset();
  const TransitionColumns& columns = dataset->columns();
  B4MRL_ASSIGN_OR_RETURN(
      const EnvironmentSpec spec,
      SpecOfDataset(request.name, columns.observation_size, columns.action_size));
  B4MRL_ASSIGN_OR_RETURN(const Corruption corruption, MakeCorruption(request.corruptions, spec));
  const std::string text = FormatNamedArguments(corruption.items);
  std::string fingerprint = entry.fingerprint;
  // A file without next observations has already been imported under the other rule.
  const bool apply_d4rl =
      request.rule == TransitionRule::kD4rl && dataset->property("transition_rule") == "stored";
  if (!corruption.empty()) {
    fingerprint = DatasetFingerprint(entry.sha256, TransitionRule::kStored, text, request.seed);
    B4MRL_ASSIGN_OR_RETURN(
        dataset, LoadOrDerive(fingerprint, *dataset, if_missing, [&](DatasetBuilder* builder) {
          builder->SetProperty("corruptions", text);
          builder->SetProperty("seed", fmt::format("{}", request.seed));
          return AppendCorrupted(dataset->columns(), corruption.set, request.seed,
                                 MatrixOfFile(entry.sha256), builder);
        }));
    if (dataset == nullptr) return OpenedDataset();
  }
  if (apply_d4rl) {
    fingerprint = DatasetFingerprint(entry.sha256, TransitionRule::kD4rl, text, request.seed);
    B4MRL_ASSIGN_OR_RETURN(
        dataset, LoadOrDerive(fingerprint, *dataset, if_missing, [&](DatasetBuilder* builder) {
          builder->SetProperty("transition_rule", TransitionRuleName(TransitionRule::kD4rl));
          return AppendUnderD4rl(dataset->columns(), builder);
        }));
  }
  OpenedDataset opened;
  opened.fingerprint = fingerprint;
  opened.info = {request.name, entry.file_bytes, entry.rows, entry.sha256, entry.behaviour_policy};
  opened.environment = dataset->property("environment");
  if (opened.environment.empty()) opened.environment = EnvironmentOfName(request.name);
  opened.corruptions = corruption.items;
  opened.hidden_dimensions = corruption.hidden_dimensions;
  opened.dataset = std::move(dataset);
  return opened;
}

void DatasetStore::RemoveUnfinished() {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(CacheRoot(), error)) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with(kUnfinishedCachePrefix)) continue;
    pid_t writer = 0;
    const char* digits = name.data() + kUnfinishedCachePrefix.size();
    std::from_chars(digits, name.data() + name.size(), writer);
    if (writer <= 0 || (kill(writer, 0) != 0 && errno == ESRCH)) RemoveCache(entry.path());
  }
}

void DatasetStore::MakeRoom(uint64_t bytes) {
  struct Cache {
    fs::file_time_type opened;
    fs::path path;
    uint64_t bytes;
  };
  std::vector<Cache> caches;
  uint64_t total = bytes;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(CacheRoot(), error)) {
    if (!IsFingerprint(entry.path().filename().string())) continue;
    caches.push_back({entry.last_write_time(error), entry.path(), FolderBytes(entry.path())});
    total += caches.back().bytes;
  }
  std::ranges::sort(caches, {}, &Cache::opened);
  for (const Cache& cache : caches) {
    if (total <= options_.max_cache_bytes) return;
    spdlog::info("removing cache {} to make room", cache.path.string());
    RemoveCache(cache.path);
    total -= cache.bytes;
  }
}

}  // namespace b4mrl
