#include "server/datasets/dataset_store.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <iterator>
#include <utility>

#include "data/columns/column_cache.h"
#include "data/columns/row_blocks.h"
#include "data/files/cache_root.h"
#include "data/files/file_hash.h"
#include "data/files/stored_bytes.h"
#include "proto/base/clock.h"
#include "proto/base/folders.h"
#include "proto/base/unique_fd.h"
#include "server/datasets/corruption.h"
#include "server/datasets/dataset_environment.h"
#include "server/datasets/dataset_files.h"
#include "server/datasets/identity.h"
#include "server/datasets/importer.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

// An import may take kMinImportMs, and longer the more bytes the file stores.
constexpr int64_t kMinImportMs = 60'000, kMaxImportMs = 3'600'000;
constexpr uint64_t kImportBytesPerMs = 4 * 1024;
// Greatest ratio of a cache's bytes to its file's, but for files that hold little but zeros.
constexpr uint64_t kUsualExpansion = 8;

uint64_t StoredBytesOf(const std::string& path) {
  return StoredBytes(UniqueFd(open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK)).get());
}

std::string EnvironmentOf(const ImportedFile& file, const std::string& name) {
  const std::string& said = file.contents.provenance.environment;
  return said.empty() ? EnvironmentOfName(name) : EnvironmentOfText(said);
}

// The fingerprint of the file `name`, whose rows are those of `dataset`.
std::string FingerprintOf(const ImportedFile& file, const std::string& name,
                          const Dataset& dataset) {
  return ImportedFingerprint(VersionedEnvironment(EnvironmentOf(file, name)), file.columns_sha256,
                             dataset.cache().properties());
}

// The numbers of `a` and `b`, ascending, without repetition; both are ascending.
std::vector<uint32_t> Union(const std::vector<uint32_t>& a, const std::vector<uint32_t>& b) {
  std::vector<uint32_t> all;
  std::ranges::set_union(a, b, std::back_inserter(all));
  return all;
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

// A file without timeouts has been cut into episodes of D4RL's step limit.
Status CheckTimeouts(const ImportedFile& file, const EnvironmentSpec& spec) {
  const uint32_t limit = spec.max_episode_steps;  // 0: of an unknown environment
  if (!file.contents.infers_timeouts || limit == 0 || limit == kD4rlStepLimit) return Status();
  return Status(
      StatusCode::kInvalidArgument,
      fmt::format("the file has no 'timeouts', without which its episodes would end after "
                  "{} steps, but those of {} end after {}; add the column",
                  kD4rlStepLimit, spec.name, limit));
}

}  // namespace

DatasetStore::DatasetStore(const Options& options)
    : options_(options),
      cache_(options.data_folder, options.max_cache_bytes),
      index_(cache_.IndexFolder()) {}

Result<std::vector<DatasetFileInfo>> DatasetStore::List() const {
  B4MRL_ASSIGN_OR_RETURN(const std::vector<DatasetFile> files,
                         FindDatasetFiles(options_.data_folder));
  std::vector<DatasetFileInfo> list;
  for (const DatasetFile& file : files) {
    const Result<FileIdentity> identity = FileIdentity::Of(file.path);
    if (!identity.ok()) continue;  // removed meanwhile
    DatasetFileInfo info;
    info.name = file.name;
    info.file_bytes = identity->bytes;
    if (const std::optional<ImportedFile> imported = index_.Find(file.name, *identity)) {
      info.rows = imported->contents.rows;
      info.sha256 = imported->sha256;
      info.behaviour_policy = imported->contents.behaviour_policy;
      info.columns_sha256 = imported->columns_sha256;
    }
    list.push_back(std::move(info));
  }
  return list;
}

Result<ImportedFile> DatasetStore::ImportFile(const DatasetFile& file, const std::string& key,
                                              const std::atomic<bool>& cancelled) {
  ImportedFile imported;
  B4MRL_ASSIGN_OR_RETURN(imported.file, FileIdentity::Of(file.path));
  const UniqueFd fd(open(file.path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (!fd.valid()) return IoError("open", file.path, errno);
  const uint64_t stored_bytes = StoredBytes(fd.get());
  B4MRL_ASSIGN_OR_RETURN(const ImportFolder folder, cache_.MakeImportFolder(key));
  const Deadline deadline = Deadline::AfterMs(std::min<int64_t>(
      kMinImportMs + static_cast<int64_t>(stored_bytes / kImportBytesPerMs), kMaxImportMs));
  spdlog::info("importing {} ({} bytes)", file.path, stored_bytes);
  const auto go_on = [&] {
    if (cancelled) return Cancelled();
    return deadline.expired() ? LateImport() : Status();
  };
  const std::string made = ImportedCachePath(folder.path());
  const auto run = [&]() -> Status {
    B4MRL_ASSIGN_OR_RETURN(
        imported.contents,
        ImportInChild(options_.importer_program, {file.path, folder.path(), cache_.max_bytes()},
                      deadline, &cancelled));
    // The hashes are computed here, because a crafted file may control what the importer says.
    B4MRL_ASSIGN_OR_RETURN(imported.sha256, Sha256OfDescriptor(fd.get(), file.path, go_on));
    B4MRL_ASSIGN_OR_RETURN(const DatasetPointer dataset, Dataset::Open(made));
    B4MRL_ASSIGN_OR_RETURN(imported.columns_sha256, HashOfRows(dataset->columns(), go_on));
    imported.fingerprint = FingerprintOf(imported, file.name, *dataset);
    return Status();
  };
  const Status status = run();
  const Result<FileIdentity> after = FileIdentity::Of(file.path);
  if (!after.ok() || *after != imported.file) {
    return Status(StatusCode::kUnavailable, "the file changed while it was imported; try again");
  }
  // A late one is remembered, too, so that files that hang do not take one place after another.
  const bool is_late = !status.ok() && !cancelled && deadline.expired();
  if (LiesInFile(status) || is_late) index_.AddFailure(file.name, imported.file, status);
  B4MRL_RETURN_IF_ERROR(status);
  B4MRL_RETURN_IF_ERROR(PlaceCache(made, cache_.PathOf(imported.fingerprint)));
  return imported;
}

Result<OpenedDataset> DatasetStore::Import(const std::string& name,
                                           const std::atomic<bool>& cancelled) {
  B4MRL_ASSIGN_OR_RETURN(const DatasetFile file, FindDatasetFile(options_.data_folder, name));
  B4MRL_RETURN_IF_ERROR(cache_.Make());
  const std::string key = DatasetIndex::KeyOf(file.name);
  B4MRL_ASSIGN_OR_RETURN(const UniqueFd lock, cache_.Lock(key, cancelled));
  B4MRL_ASSIGN_OR_RETURN(auto found,
                         FindImported(file, cancelled));  // another daemon may have been first
  auto& [imported, dataset] = found;
  if (dataset == nullptr) {
    Result<ImportedFile> made = ImportFile(file, key, cancelled);
    if (!made.ok() &&
        cache_.MakeRoomOnDisk(StoredBytesOf(file.path) * kUsualExpansion, made.status())) {
      made = ImportFile(file, key, cancelled);
    }
    B4MRL_ASSIGN_OR_RETURN(imported, std::move(made));
    B4MRL_ASSIGN_OR_RETURN(dataset, Admit(imported.fingerprint));
    B4MRL_RETURN_IF_ERROR(index_.Add(file.name, imported));
  }
  OpenedDataset opened;
  opened.fingerprint = imported.fingerprint;
  opened.dataset = std::move(dataset);
  return opened;
}

Result<DatasetStore::DatasetPointer> DatasetStore::Load(const std::string& fingerprint,
                                                        const std::atomic<bool>& cancelled) {
  if (!IsHash128(fingerprint)) {
    const Status malformed =
        InvalidArgument("fingerprint", fingerprint, "32 lower-case hexadecimal digits");
    return Status(StatusCode::kUnknownName, malformed.message());
  }
  cache_.Touch(fingerprint);
  {
    const std::lock_guard lock(mutex_);
    if (DatasetPointer mapped = mapped_[fingerprint].lock()) return mapped;
    mapped_.erase(fingerprint);
  }
  const std::string folder = cache_.PathOf(fingerprint);
  const uint64_t identity = FolderIdentity(folder);
  Result<DatasetPointer> dataset = Dataset::Open(folder);
  const auto is_cancelled = [&] { return stopped_ || cancelled; };
  const Status status = dataset.ok() ? (*dataset)->cache().Verify(is_cancelled) : dataset.status();
  // Another thread may have made it anew meanwhile.
  if (IsDamage(status) && FolderIdentity(folder) == identity) {
    spdlog::error("removing a damaged cache: {}", status.ToString());
    RemoveCache(folder);
  }
  if (status.code() == StatusCode::kUnknownName) {
    return Status(StatusCode::kUnknownName,
                  fmt::format("no dataset has the fingerprint {}; open it again", fingerprint));
  }
  if (!status.ok()) return status;
  const std::lock_guard lock(mutex_);
  std::erase_if(mapped_, [](const auto& entry) { return entry.second.expired(); });
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

Status DatasetStore::Replace(DatasetPointer* dataset, const std::string& fingerprint,
                             IfMissing if_missing, const std::atomic<bool>& cancelled,
                             const std::function<Status(DatasetBuilder*)>& derive) {
  const DatasetPointer source = *dataset;
  UniqueFd lock;
  if (if_missing == IfMissing::kDerive) {
    B4MRL_ASSIGN_OR_RETURN(lock, cache_.Lock(fingerprint, cancelled));
  }
  Result<DatasetPointer> cached = Load(fingerprint, cancelled);
  if (!IsToBeMade(cached.status())) {
    B4MRL_ASSIGN_OR_RETURN(*dataset, std::move(cached));
    return Status();
  }
  *dataset = nullptr;
  if (if_missing == IfMissing::kLeave) return Status();
  const uint64_t bytes = source->cache().bytes();
  if (bytes > cache_.max_bytes()) {
    return Status(StatusCode::kLimitExceeded, fmt::format("the dataset takes {} bytes, allowed: {}",
                                                          bytes, cache_.max_bytes()));
  }
  const auto make = [&]() -> Status {
    B4MRL_ASSIGN_OR_RETURN(
        DatasetBuilder builder,
        DatasetBuilder::Create(cache_.PathOf(fingerprint), source->columns().observation_size,
                               source->columns().action_size));
    for (const auto& [name, value] : source->cache().properties()) builder.SetProperty(name, value);
    builder.SetReturns(source->statistics());
    B4MRL_RETURN_IF_ERROR(derive(&builder));
    return builder.Commit();
  };
  Status made = make();
  if (!made.ok() && cache_.MakeRoomOnDisk(bytes, made)) made = make();
  B4MRL_RETURN_IF_ERROR(made);
  B4MRL_ASSIGN_OR_RETURN(*dataset, Admit(fingerprint));
  return Status();
}

Result<OpenedDataset> DatasetStore::Open(const DatasetRequest& request,
                                         const std::atomic<bool>& cancelled) {
  return FindAndOpen(request, IfMissing::kLeave, cancelled);
}

Result<OpenedDataset> DatasetStore::Derive(const DatasetRequest& request,
                                           const std::atomic<bool>& cancelled) {
  return FindAndOpen(request, IfMissing::kDerive, cancelled);
}

Result<std::pair<ImportedFile, DatasetStore::DatasetPointer>> DatasetStore::FindImported(
    const DatasetFile& file, const std::atomic<bool>& cancelled) {
  B4MRL_ASSIGN_OR_RETURN(const FileIdentity identity, FileIdentity::Of(file.path));
  std::pair<ImportedFile, DatasetPointer> found;
  if (std::optional<ImportedFile> imported = index_.Find(file.name, identity)) {
    Result<DatasetPointer> dataset = Load(imported->fingerprint, cancelled);
    if (!dataset.ok() && !IsToBeMade(dataset.status())) return dataset.status();
    // A file that was imported for another version of its environment is imported again.
    if (dataset.ok() && FingerprintOf(*imported, file.name, **dataset) == imported->fingerprint) {
      found = {std::move(*imported), std::move(*dataset)};
    }
  }
  if (found.second == nullptr) B4MRL_RETURN_IF_ERROR(index_.FindFailure(file.name, identity));
  return found;
}

Result<OpenedDataset> DatasetStore::FindAndOpen(const DatasetRequest& request, IfMissing if_missing,
                                                const std::atomic<bool>& cancelled) {
  B4MRL_ASSIGN_OR_RETURN(const DatasetFile file,
                         FindDatasetFile(options_.data_folder, request.name));
  B4MRL_ASSIGN_OR_RETURN(const auto found, FindImported(file, cancelled));
  if (found.second != nullptr) {
    Result<OpenedDataset> opened =
        OpenImported(request, found.first, found.second, if_missing, cancelled);
    if (opened.ok()) opened->info.name = file.name;  // the full name
    return opened;
  }
  OpenedDataset missing;
  missing.missing = OpenedDataset::Missing::kImport;
  missing.source_bytes = StoredBytesOf(file.path);
  return missing;
}

Result<OpenedDataset> DatasetStore::OpenImported(const DatasetRequest& request,
                                                 const ImportedFile& file, DatasetPointer dataset,
                                                 IfMissing if_missing,
                                                 const std::atomic<bool>& cancelled) {
  const TransitionColumns columns = dataset->columns();
  const DatasetProvenance& provenance = file.contents.provenance;
  // A crafted file may make the importer say anything, and its answers lie in the data folder.
  B4MRL_RETURN_IF_ERROR(provenance.CheckHidden(columns.observation_size));
  const std::string environment = EnvironmentOf(file, request.name);
  B4MRL_RETURN_IF_ERROR(CheckEnvironment(request.name, environment, columns, request.environment));
  B4MRL_ASSIGN_OR_RETURN(
      const EnvironmentSpec spec,
      SpecOfDataset(request.name, environment, columns.observation_size, columns.action_size));
  B4MRL_RETURN_IF_ERROR(CheckTimeouts(file, spec));
  B4MRL_ASSIGN_OR_RETURN(const Corruption corruption, MakeCorruption(request.corruptions, spec));
  const std::string text = FormatNamedArguments(corruption.set.items());
  // A file without next observations has already been imported under the other rule.
  B4MRL_ASSIGN_OR_RETURN(const TransitionRule imported_rule,
                         ParseTransitionRule(dataset->property("transition_rule")));
  const TransitionRule applied_rule =
      imported_rule == TransitionRule::kStored ? request.rule : TransitionRule::kStored;
  OpenedDataset opened;
  opened.info = {request.name,
                 file.file.bytes,
                 file.contents.rows,
                 file.sha256,
                 file.contents.behaviour_policy,
                 file.columns_sha256};
  opened.environment = environment;
  opened.provenance = provenance;
  opened.corruptions = corruption.set.items();
  opened.seed = corruption.draws ? request.seed : 0;
  opened.rule = imported_rule == TransitionRule::kStored ? request.rule : imported_rule;
  opened.hidden_dimensions = Union(provenance.hidden_dimensions, corruption.hidden_dimensions);
  opened.source_bytes = dataset->cache().bytes();
  opened.source_fingerprint = file.fingerprint;
  opened.source = dataset;
  DerivedRows derived = {text, opened.seed};
  if (corruption.draws) derived.hidden = provenance.hidden_dimensions;
  const std::string corrupted = DerivedFingerprint(file.fingerprint, derived);
  derived.rule = applied_rule;
  opened.fingerprint = DerivedFingerprint(file.fingerprint, derived);

  if (!corruption.set.empty()) {
    const auto derive = [&, source = dataset](DatasetBuilder* builder) {
      builder->SetProperty("corruptions", text);
      builder->SetProperty("seed", fmt::format("{}", opened.seed));
      const uint64_t matrix = NoiseMatrix(VersionedEnvironment(environment), file.columns_sha256);
      return AppendCorrupted(source->columns(),
                             {corruption.set, opened.seed, matrix, provenance.hidden_dimensions},
                             cancelled, builder);
    };
    B4MRL_RETURN_IF_ERROR(Replace(&dataset, corrupted, if_missing, cancelled, derive));
  }
  if (applied_rule == TransitionRule::kD4rl && dataset != nullptr) {
    const auto derive = [&, source = dataset](DatasetBuilder* builder) {
      builder->SetProperty("transition_rule", TransitionRuleName(TransitionRule::kD4rl));
      const auto go_on = [&] { return cancelled ? Cancelled() : Status(); };
      return AppendUnderD4rl(source->columns(), go_on, builder);
    };
    const Status made = Replace(&dataset, opened.fingerprint, if_missing, cancelled, derive);
    if (!made.ok()) {
      return made.WithContext(fmt::format("{} with transition_rule {}", request.name,
                                          TransitionRuleName(TransitionRule::kD4rl)));
    }
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
  cache_.RemoveLeftovers();
}

}  // namespace b4mrl
