// The datasets of a data folder and their caches on disk: finds files, has them imported, derives
// what corruptions and transition rules ask for, and maps the results.
//
//   DATA/.cache/<fingerprint>/      a column cache: of a file, or derived from one
//   DATA/.cache/index/<hash>.json   what a file was when it was imported: size, time, SHA-256
//
// Thread rule: one thread opens, another one may list, load and open what is prepared meanwhile;
// the Datasets that they return are immutable and may be read by any. Errors: kUnknownName, those
// of the importer, kIoError.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "data/dataset.h"
#include "data/dataset_builder.h"
#include "data/episodes.h"
#include "proto/base/clock.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

struct DatasetFileInfo {
  std::string name;
  uint64_t file_bytes = 0;
  // Known once the file has been imported.
  uint64_t rows = 0;
  std::string sha256;
  std::string behaviour_policy;
};

struct DatasetRequest {
  std::string name;
  std::vector<NamedArgument> corruptions;
  uint64_t seed = 0;
  TransitionRule rule = TransitionRule::kStored;
};

struct OpenedDataset {
  std::string fingerprint;
  DatasetFileInfo info;
  std::string environment;                  // as the file says, else as its name; "" if neither
  std::vector<NamedArgument> corruptions;   // parametric forms
  std::vector<uint32_t> hidden_dimensions;  // sorted
  std::shared_ptr<const Dataset> dataset;
};

class DatasetStore {
 public:
  struct Options {
    std::string data_folder;
    std::string importer_program;
    uint64_t max_cache_bytes = 0;
    const std::atomic<bool>* cancelled = nullptr;  // ends a running import when it turns true
  };
  explicit DatasetStore(Options options) : options_(std::move(options)) {}

  // Sorted by name. kIoError when the data folder cannot be read.
  Result<std::vector<DatasetFileInfo>> List() const;
  // What to do where no cache has what is asked for.
  enum class IfMissing {
    kMake,      // import and derive it: takes as long as that does
    kGiveNull,  // return an OpenedDataset whose dataset is null, in milliseconds
  };
  Result<OpenedDataset> Open(const DatasetRequest& request,
                             IfMissing if_missing = IfMissing::kMake);
  // A dataset that an earlier Open made, perhaps of another process. kUnknownName if it is no more.
  Result<std::shared_ptr<const Dataset>> Load(const std::string& fingerprint);
  // Removes what killed processes left half-made.
  void RemoveUnfinished();

 private:
  struct File {
    std::string name;
    std::string path;
  };
  // What identifies a file's contents without reading it, and what an import found out.
  struct IndexEntry;

  std::string CacheRoot() const { return options_.data_folder + "/.cache"; }
  std::string CacheFolder(const std::string& fingerprint) const;
  std::string IndexPath(const std::string& name) const;
  Result<std::vector<File>> FindFiles() const;
  Result<File> FindFile(const std::string& name) const;
  std::optional<IndexEntry> ReadIndex(const File& file) const;
  Status WriteIndex(const File& file, const IndexEntry& entry) const;
  Result<IndexEntry> Import(const File& file);
  // Like Open, these give null where something is missing and not to be made.
  Result<std::shared_ptr<const Dataset>> OpenSource(const File& file, IfMissing if_missing,
                                                    IndexEntry* entry);
  // The dataset of `fingerprint`: from the cache, or made by `derive` and then cached.
  Result<std::shared_ptr<const Dataset>> LoadOrDerive(
      const std::string& fingerprint, const Dataset& source, IfMissing if_missing,
      const std::function<Status(DatasetBuilder*)>& derive);
  // Makes room for `bytes` more by removing the caches that were opened longest ago.
  void MakeRoom(uint64_t bytes);

  Options options_;
  std::mutex mutex_;
  // What somebody still holds need not be mapped and verified again. Under mutex_.
  std::map<std::string, std::weak_ptr<const Dataset>> mapped_;
};

}  // namespace b4mrl
