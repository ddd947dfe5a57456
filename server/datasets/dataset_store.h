// The datasets of a data folder and their caches: finds files, has them imported, derives datasets
// under corruptions and transition rules, and maps the results.
//
// Several stores, in one process or in several, may share a data folder: one of them makes a cache
// while the others wait for it. Thread rule: any thread. The Datasets that are
// returned are immutable; any thread may read them. Errors: kUnknownName, those of the importer,
// kIoError, kLimitExceeded (more bytes than the caches may take), kUnavailable (cancelled).
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "data/columns/dataset.h"
#include "data/columns/dataset_builder.h"
#include "data/columns/episodes.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"
#include "server/datasets/cache_folder.h"
#include "server/datasets/dataset_files.h"
#include "server/datasets/dataset_index.h"

namespace b4mrl {

struct DatasetFileInfo {
  std::string name;
  uint64_t file_bytes = 0;
  // 0 or "" until the file has been imported.
  uint64_t rows = 0;
  std::string sha256;
  std::string behaviour_policy;
  std::string columns_sha256;
};

struct DatasetRequest {
  std::string name;  // "HalfCheetah/medium-v0"; without a version the newest, unless a file has it
  std::vector<NamedArgument> corruptions;
  uint64_t seed = 0;
  TransitionRule rule = TransitionRule::kStored;
  std::string environment;  // refuse data of another environment; "" takes any
};

struct OpenedDataset {
  std::string fingerprint;
  DatasetFileInfo info;
  std::string environment;                 // as the file says, else as its name; "" if neither
  DatasetProvenance provenance;            // as the file says
  std::vector<NamedArgument> corruptions;  // parametric forms
  uint64_t seed = 0;                       // of their noise; 0 where they draw none
  TransitionRule rule = TransitionRule::kStored;  // in force
  std::vector<uint32_t> hidden_dimensions;  // by corruptions or for the behaviour policy; sorted
  std::shared_ptr<const Dataset> dataset;   // null unless `missing` is kNothing

  // What it is derived from, mapped: whoever keeps it spares the next opening a reading of it.
  std::string source_fingerprint;
  std::shared_ptr<const Dataset> source;  // null until it is imported

  // The step that has to be done first, and how many bytes it reads.
  enum class Missing { kNothing, kImport, kDerivation } missing = Missing::kNothing;
  uint64_t source_bytes = 0;
};

// For work that nobody cancels.
inline const std::atomic<bool> kNeverCancelled{false};

class DatasetStore {
 public:
  struct Options {
    std::string data_folder;
    std::string importer_program;
    uint64_t max_cache_bytes = 0;
  };
  explicit DatasetStore(const Options& options);

  // All datasets, sorted by name. kIoError when the data folder cannot be read.
  Result<std::vector<DatasetFileInfo>> List() const;

  // Opens a dataset from the caches; where they lack it, `missing` says whether Import or Derive
  // has to be called first. Takes milliseconds, but a cache that is not mapped yet is read whole
  // once, which may take a minute; kUnavailable soon after `cancelled` turned true.
  Result<OpenedDataset> Open(const DatasetRequest& request,
                             const std::atomic<bool>& cancelled = kNeverCancelled);
  // Imports the file of that name, which may take minutes. Of the result, only `fingerprint` and
  // `dataset` are set. A failure that lies in the file is remembered, and Open returns it from then
  // on. Returns soon after `cancelled` turned true. If another daemon imports the file already,
  // waits for it.
  Result<OpenedDataset> Import(const std::string& name, const std::atomic<bool>& cancelled);
  // Opens a dataset and derives it if it is missing; its file must have been imported.
  Result<OpenedDataset> Derive(const DatasetRequest& request, const std::atomic<bool>& cancelled);

  // Maps a dataset that was made earlier, perhaps by another process, and reads it whole once.
  // kUnknownName if its cache is gone; kUnavailable soon after `cancelled` turned true.
  Result<std::shared_ptr<const Dataset>> Load(const std::string& fingerprint,
                                              const std::atomic<bool>& cancelled = kNeverCancelled);

  // Has calls of other threads that read a cache return soon: kUnavailable.
  void Stop() { stopped_ = true; }

  // To be called at the start: sets the caches' modes and removes what dead processes have left:
  // unfinished caches, and files of locks.
  void TidyUp();

 private:
  using DatasetPointer = std::shared_ptr<const Dataset>;
  // Whether a missing dataset is to be derived.
  enum class IfMissing { kLeave, kDerive };
  Result<OpenedDataset> OpenImported(const DatasetRequest& request, const ImportedFile& file,
                                     DatasetPointer dataset, IfMissing if_missing,
                                     const std::atomic<bool>& cancelled);
  Result<OpenedDataset> FindAndOpen(const DatasetRequest& request, IfMissing if_missing,
                                    const std::atomic<bool>& cancelled);
  // The remembered import of a file and its dataset, mapped; null if the file has to be imported.
  Result<std::pair<ImportedFile, DatasetPointer>> FindImported(const DatasetFile& file,
                                                               const std::atomic<bool>& cancelled);
  Result<ImportedFile> ImportFile(const DatasetFile& file, const std::string& key,
                                  const std::atomic<bool>& cancelled);
  // Replaces `*dataset` by the dataset of `fingerprint`: from the cache, or made by `derive` if it
  // is to be, else null.
  Status Replace(DatasetPointer* dataset, const std::string& fingerprint, IfMissing if_missing,
                 const std::atomic<bool>& cancelled,
                 const std::function<Status(DatasetBuilder*)>& derive);
  // Maps a cache that was just made and makes room for it. Removes the new cache if there is none.
  Result<DatasetPointer> Admit(const std::string& fingerprint);

  Options options_;
  CacheFolder cache_;
  DatasetIndex index_;
  std::atomic<bool> stopped_ = false;
  std::mutex mutex_;
  // Datasets that a caller still holds need not be mapped and verified again. Under mutex_.
  std::map<std::string, std::weak_ptr<const Dataset>> mapped_;
};

}  // namespace b4mrl
