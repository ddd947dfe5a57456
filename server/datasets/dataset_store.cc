#include "server/datasets/dataset_store.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <limits>
#include <utility>

#include "data/columns/column_cache.h"
#include "data/d4rl/import_dataset.h"
#include "data/files/cache_root.h"
#include "data/files/file_hash.h"
#include "data/files/stored_bytes.h"
#include "proto/base/clock.h"
#include "proto/base/limits.h"
#include "proto/base/unique_fd.h"
#include "server/datasets/corruption.h"
#include "server/datasets/dataset_replies.h"
#include "server/datasets/importer.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

// An import may take kMinImportMs, and longer the more bytes the file stores.
constexpr int64_t kMinImportMs = 60'000, kMaxImportMs = 3'600'000;
constexpr uint64_t kImportBytesPerMs = 4 * 1024;

// Whether a name can travel in messages, whose strings must be UTF-8, and be typed by people.
bool IsPlainName(std::string_view name) {
  return std::ranges::all_of(name, [](char c) { return c > ' ' && c <= '~'; });
}

// N if the name of a file is `name` with the version "-vN"; else -1.
int64_t VersionOf(std::string_view file_name, std::string_view name) {
  if (!file_name.starts_with(name)) return -1;
  file_name.remove_prefix(name.size());
  if (!file_name.starts_with("-v")) return -1;
  const Result<uint64_t> version =
      ParseUnsigned("version", file_name.substr(2), 0, std::numeric_limits<int32_t>::max());
  return version.ok() ? static_cast<int64_t>(*version) : -1;
}

// The extension that a dataset file has in a folder of DATA.
std::string_view ExtensionIn(const std::string& folder) {
  return folder == "d4rl" ? ".hdf5" : ".h5";
}

// Appends the rows that the rule d4rl keeps, in blocks, because a builder holds a block in memory.
Status AppendUnderD4rl(const TransitionColumns& all, const std::atomic<bool>& cancelled,
                       DatasetBuilder* builder) {
  constexpr uint64_t kBlockRows = 65536;
  builder->AddRewards(all.rewards, all.terminals, all.timeouts);
  for (uint64_t first = 0; first < all.rows; first += kBlockRows) {
    if (cancelled) return Cancelled();
    const TransitionColumns block = all.Rows(first, std::min(kBlockRows, all.rows - first));
    const uint64_t end = first + block.rows;
    const TransitionColumns following = all.Rows(end, std::min<uint64_t>(1, all.rows - end));
    B4MRL_RETURN_IF_ERROR(
        builder->AppendD4rl(block, first, all.terminals, all.timeouts, following.observations));
  }
  return Status();
}

// Whether a cache's files are damaged. A passing shortage of memory or descriptors is no damage.
bool IsDamage(const Status& status) {
  return status.code() == StatusCode::kDataLoss || status.code() == StatusCode::kVersionMismatch;
}

// Whether a dataset is to be imported or derived again, when loading it gave `status`: its cache is
// missing or damaged.
bool IsToBeMade(const Status& status) {
  return status.code() == StatusCode::kUnknownName || IsDamage(status);
}

// Whether an import would fail again, because its error lies in the file itself.
bool LiesInFile(const Status& failure) {
  return IsDamage(failure) || failure.code() == StatusCode::kInvalidArgument ||
         failure.code() == StatusCode::kUnknownName || failure.code() == StatusCode::kLimitExceeded;
}

}  // namespace

DatasetStore::DatasetStore(const Options& options)
    : options_(options),
      cache_(options.data_folder, options.max_cache_bytes),
      index_(cache_.IndexFolder()) {}

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
  const File* newest = nullptr;
  int64_t newest_version = -1;
  for (const File& file : files) {
    if (file.name == name) return file;
    names.push_back(file.name);
    const int64_t version = VersionOf(file.name, name);
    if (version <= newest_version) continue;
    newest_version = version;
    newest = &file;
  }
  if (newest != nullptr) return *newest;
  return UnknownName("dataset", name, names);
}

Result<std::vector<DatasetFileInfo>> DatasetStore::List() const {
  B4MRL_ASSIGN_OR_RETURN(const std::vector<File> files, FindFiles());
  std::vector<DatasetFileInfo> list;
  for (const File& file : files) {
    const Result<FileIdentity> identity = FileIdentity::Of(file.path);
    if (!identity.ok()) continue;  // removed meanwhile
    DatasetFileInfo info;
    info.name = file.name;
    info.file_bytes = identity->bytes;
    if (const std::optional<ImportedFile> imported = index_.Find(file.name, *identity)) {
      info.rows = imported->rows;
      info.sha256 = imported->sha256;
      info.behaviour_policy = imported->behaviour_policy;
    }
    list.push_back(std::move(info));
  }
  return list;
}

Result<ImportedFile> DatasetStore::ImportFile(const File& file,
                                              const std::atomic<bool>& cancelled) {
  ImportedFile imported;
  B4MRL_ASSIGN_OR_RETURN(imported.file, FileIdentity::Of(file.path));
  const UniqueFd fd(open(file.path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (!fd.valid()) return IoError("open", file.path, errno);
  const uint64_t stored_bytes = StoredBytes(fd.get());
  B4MRL_RETURN_IF_ERROR(cache_.Make());
  B4MRL_ASSIGN_OR_RETURN(const ImportFolder folder, cache_.MakeImportFolder());
  const Deadline deadline = Deadline::AfterMs(std::min<int64_t>(
      kMinImportMs + static_cast<int64_t>(stored_bytes / kImportBytesPerMs), kMaxImportMs));
  spdlog::info("importing {} ({} bytes)", file.path, stored_bytes);
  const auto go_on = [&] {
    if (cancelled) return Cancelled();
    return deadline.expired() ? Status(StatusCode::kDataLoss, "its import did not end in time")
                              : Status();
  };
  const auto run = [&]() -> Status {
    B4MRL_ASSIGN_OR_RETURN(
        imported.rows,
        ImportInChild(options_.importer_program, {file.path, folder.path(), cache_.max_bytes()},
                      deadline, &cancelled));
    // The hash is computed here, because a crafted file may control what the importer says.
    B4MRL_ASSIGN_OR_RETURN(imported.sha256, Sha256OfDescriptor(fd.get(), file.path, go_on));
    return Status();
  };
  const Status status = run();
  const Result<FileIdentity> after = FileIdentity::Of(file.path);
  if (!after.ok() || *after != imported.file) {
    return Status(StatusCode::kUnavailable, "the file changed while it was imported; try again");
  }
  if (LiesInFile(status)) index_.AddFailure(file.name, imported.file, status);
  B4MRL_RETURN_IF_ERROR(status);
  imported.fingerprint = DatasetFingerprint(imported.sha256, TransitionRule::kStored, "", 0);
  B4MRL_RETURN_IF_ERROR(
      PlaceCache(ImportedCachePath(folder.path()), cache_.PathOf(imported.fingerprint)));
  return imported;
}

Result<OpenedDataset> DatasetStore::Import(const std::string& name,
                                           const std::atomic<bool>& cancelled) {
  B4MRL_ASSIGN_OR_RETURN(const File file, FindFile(name));
  B4MRL_ASSIGN_OR_RETURN(ImportedFile imported, ImportFile(file, cancelled));
  OpenedDataset opened;
  opened.fingerprint = imported.fingerprint;
  B4MRL_ASSIGN_OR_RETURN(opened.dataset, Admit(imported.fingerprint));
  // The whole text may be longer than what DatasetIndex reads again.
  imported.behaviour_policy = PlainPolicy(opened.dataset->property("behaviour_policy"));
  B4MRL_RETURN_IF_ERROR(index_.Add(file.name, imported));
  return opened;
}

Result<DatasetStore::DatasetPointer> DatasetStore::Load(const std::string& fingerprint) {
  if (!IsHash128(fingerprint)) {
    return Status(StatusCode::kUnknownName, "a fingerprint is 32 hexadecimal digits");
  }
  cache_.Touch(fingerprint);
  {
    const std::lock_guard lock(mutex_);
    if (DatasetPointer mapped = mapped_[fingerprint].lock()) return mapped;
    mapped_.erase(fingerprint);
  }
  const std::string folder = cache_.PathOf(fingerprint);
  Result<DatasetPointer> dataset = Dataset::Open(folder);
  const Status status = dataset.ok() ? (*dataset)->cache().Verify() : dataset.status();
  if (IsDamage(status)) {
    spdlog::error("removing a damaged cache: {}", status.ToString());
    RemoveCache(folder);
  }
  if (status.code() == StatusCode::kUnknownName) {
    return Status(StatusCode::kUnknownName,
                  fmt::format("no dataset has the fingerprint {}; open it again", fingerprint));
  }
  if (!status.ok()) return status;
  const std::lock_guard lock(mutex_);
  mapped_[fingerprint] = *dataset;
  return dataset;
}

Result<DatasetStore::DatasetPointer> DatasetStore::Admit(const std::string& fingerprint) {
  B4MRL_ASSIGN_OR_RETURN(DatasetPointer dataset, Load(fingerprint));
  const Status room = cache_.MakeRoom();
  if (room.ok()) return dataset;
  RemoveCache(cache_.PathOf(fingerprint));
  return room;
}

Status DatasetStore::Replace(DatasetPointer* dataset, const std::string& fingerprint, bool make,
                             const std::function<Status(DatasetBuilder*)>& derive) {
  const DatasetPointer source = *dataset;
  Result<DatasetPointer> cached = Load(fingerprint);
  if (!IsToBeMade(cached.status())) {
    B4MRL_ASSIGN_OR_RETURN(*dataset, std::move(cached));
    return Status();
  }
  *dataset = nullptr;
  if (!make) return Status();
  const uint64_t bytes = source->cache().bytes();
  if (bytes > cache_.max_bytes()) {
    return Status(StatusCode::kLimitExceeded, fmt::format("the dataset takes {} bytes, allowed: {}",
                                                          bytes, cache_.max_bytes()));
  }
  B4MRL_ASSIGN_OR_RETURN(
      DatasetBuilder builder,
      DatasetBuilder::Create(cache_.PathOf(fingerprint), source->columns().observation_size,
                             source->columns().action_size));
  for (const auto& [name, value] : source->cache().properties()) builder.SetProperty(name, value);
  B4MRL_RETURN_IF_ERROR(derive(&builder));
  B4MRL_RETURN_IF_ERROR(builder.Commit());
  B4MRL_ASSIGN_OR_RETURN(*dataset, Admit(fingerprint));
  return Status();
}

Result<OpenedDataset> DatasetStore::Open(const DatasetRequest& request) {
  return FindAndOpen(request, nullptr);
}

Result<OpenedDataset> DatasetStore::Derive(const DatasetRequest& request,
                                           const std::atomic<bool>& cancelled) {
  return FindAndOpen(request, &cancelled);
}

Result<OpenedDataset> DatasetStore::FindAndOpen(const DatasetRequest& request,
                                                const std::atomic<bool>* cancelled) {
  B4MRL_ASSIGN_OR_RETURN(const File file, FindFile(request.name));
  B4MRL_ASSIGN_OR_RETURN(const FileIdentity identity, FileIdentity::Of(file.path));
  if (const std::optional<ImportedFile> imported = index_.Find(file.name, identity)) {
    Result<DatasetPointer> dataset = Load(imported->fingerprint);
    if (dataset.ok()) {
      Result<OpenedDataset> opened = OpenImported(request, *imported, *dataset, cancelled);
      if (opened.ok()) opened->info.name = file.name;  // the full name
      return opened;
    }
    if (!IsToBeMade(dataset.status())) return dataset.status();
  }
  B4MRL_RETURN_IF_ERROR(index_.FindFailure(file.name, identity));
  OpenedDataset missing;
  missing.missing = OpenedDataset::Missing::kImport;
  missing.source_bytes =
      StoredBytes(UniqueFd(open(file.path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK)).get());
  return missing;
}

Result<OpenedDataset> DatasetStore::OpenImported(const DatasetRequest& request,
                                                 const ImportedFile& file, DatasetPointer dataset,
                                                 const std::atomic<bool>* cancelled) {
  const TransitionColumns columns = dataset->columns();
  B4MRL_ASSIGN_OR_RETURN(
      const EnvironmentSpec spec,
      SpecOfDataset(request.name, columns.observation_size, columns.action_size));
  B4MRL_ASSIGN_OR_RETURN(const Corruption corruption, MakeCorruption(request.corruptions, spec));
  const std::string text = FormatNamedArguments(corruption.set.items());
  // A file without next observations has already been imported under the other rule.
  const bool apply_d4rl =
      request.rule == TransitionRule::kD4rl && dataset->property("transition_rule") == "stored";
  const auto fingerprint_under = [&](TransitionRule rule) {
    return DatasetFingerprint(file.sha256, rule, text, request.seed);
  };
  OpenedDataset opened;
  opened.fingerprint =
      fingerprint_under(apply_d4rl ? TransitionRule::kD4rl : TransitionRule::kStored);
  opened.info = {request.name, file.file.bytes, file.rows, file.sha256, file.behaviour_policy};
  opened.environment = dataset->property("environment");
  if (opened.environment.empty()) opened.environment = EnvironmentOfName(request.name);
  opened.corruptions = corruption.set.items();
  opened.hidden_dimensions = corruption.hidden_dimensions;
  opened.source_bytes = dataset->cache().bytes();

  const bool make = cancelled != nullptr;
  if (!corruption.set.empty()) {
    const auto derive = [&, source = dataset](DatasetBuilder* builder) {
      builder->SetProperty("corruptions", text);
      builder->SetProperty("seed", fmt::format("{}", request.seed));
      return AppendCorrupted(source->columns(), corruption.set, request.seed,
                             MatrixOfFile(file.sha256), *cancelled, builder);
    };
    B4MRL_RETURN_IF_ERROR(
        Replace(&dataset, fingerprint_under(TransitionRule::kStored), make, derive));
  }
  if (apply_d4rl && dataset != nullptr) {
    const auto derive = [&, source = dataset](DatasetBuilder* builder) {
      builder->SetProperty("transition_rule", TransitionRuleName(TransitionRule::kD4rl));
      return AppendUnderD4rl(source->columns(), *cancelled, builder);
    };
    B4MRL_RETURN_IF_ERROR(Replace(&dataset, opened.fingerprint, make, derive));
  }
  if (dataset == nullptr) opened.missing = OpenedDataset::Missing::kDerivation;
  opened.dataset = std::move(dataset);
  return opened;
}

void DatasetStore::TidyUp() {
  // Without caches there is nothing to do.
  std::error_code error;
  if (!fs::exists(CacheRoot(options_.data_folder), error)) return;
  if (const Status status = cache_.Make(); !status.ok()) spdlog::warn("{}", status.ToString());
  cache_.RemoveUnfinished();
}

}  // namespace b4mrl
