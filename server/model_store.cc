#include "server/model_store.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include <algorithm>
#include <filesystem>
#include <optional>
#include <vector>

#include "data/cache_root.h"
#include "proto/base/limits.h"
#include "server/environments/list.h"
#include "server/environments/model_file.h"
#include "server/model_compiler.h"
#include "server/perturbations/list.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

// What a folder's files are without reading them: names, sizes, times. Nothing when there are too
// many to look at.
std::optional<uint64_t> StateOfFolder(const std::string& folder) {
  constexpr size_t kMostEntries = 4096;
  std::vector<std::string> entries;
  std::error_code error;
  for (fs::recursive_directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    if (entries.size() == kMostEntries) return std::nullopt;
    struct stat info {};
    if (stat(entry->path().c_str(), &info) != 0) continue;
    entries.push_back(fmt::format("{}\n{} {} {} {}.{}", entry->path().string(), info.st_ino,
                                  info.st_mode, info.st_size, info.st_mtim.tv_sec,
                                  info.st_mtim.tv_nsec));
  }
  if (error) return std::nullopt;
  std::ranges::sort(entries);
  const std::string all = fmt::format("{}", fmt::join(entries, "\n"));
  return XXH3_64bits(all.data(), all.size());
}

// Removes the compiled models that were used longest ago.
void MakeRoom(const std::string& cache_folder) {
  std::vector<std::pair<fs::file_time_type, fs::path>> models;
  std::error_code error;
  for (fs::directory_iterator entry(cache_folder, error), end; !error && entry != end;
       entry.increment(error)) {
    std::error_code ignored;
    models.emplace_back(entry->last_write_time(ignored), entry->path());
  }
  if (models.size() <= limits::kMaxCompiledModels) return;
  std::ranges::sort(models);
  models.resize(models.size() - limits::kMaxCompiledModels);
  for (const auto& [used, path] : models) fs::remove(path, error);
}

}  // namespace

struct ModelStore::Cache {
  struct Entry {
    uint64_t folder_state;
    Result<std::string> hash;  // or why the file is refused
  };

  // Also tells the file system that the model is in use.
  bool InCache(const std::string& hash) const {
    return utimensat(AT_FDCWD, CompiledModelPath(folder, hash).c_str(), nullptr, 0) == 0;
  }

  Result<std::string> Compile(const std::string& environment, const std::string& file,
                              const Deadline& deadline) {
    const std::optional<uint64_t> state = StateOfFolder(options.models_folder);
    const auto known = hashes.find({environment, file});
    if (state && known != hashes.end() && known->second.folder_state == *state) {
      const Result<std::string>& hash = known->second.hash;
      if (!hash.ok() || InCache(*hash)) return hash;
    }
    std::error_code error;
    fs::create_directories(options.data_folder, error);
    if (error) return IoError("create", options.data_folder, error.value());
    B4MRL_RETURN_IF_ERROR(MakeCacheRoot(options.data_folder));
    B4MRL_RETURN_IF_ERROR(MakeFolderInside(folder));
    const Result<std::string> hash = CompileModelInChild(
        options.program, {options.models_folder, file, environment, folder},
        Deadline::AfterMs(std::min(deadline.remaining_ms(), limits::kModelCompilerMs)));
    if (hash.ok()) {
      InCache(*hash);
      MakeRoom(folder);
    }
    if (hashes.size() >= limits::kMaxCompiledModels) hashes.clear();
    // A refusal that the file has earned is kept, too: clients ask again and again. Changed while
    // it was compiled: the next request compiles again.
    const bool is_lasting = hash.ok() || hash.status().code() == StatusCode::kInvalidArgument ||
                            hash.status().code() == StatusCode::kUnsupported;
    if (is_lasting && state && StateOfFolder(options.models_folder) == state) {
      hashes.insert_or_assign({environment, file}, Entry{*state, hash});
    }
    return hash;
  }

  Options options;
  std::string folder;
  std::map<std::pair<std::string, std::string>, Entry> hashes;  // by environment and file
};

std::string ModelCacheFolder(const std::string& data_folder) {
  return CacheRoot(data_folder) + "/models";
}

ModelStore::ModelStore(Options options)
    : cache_(std::make_shared<Cache>(Cache{options, ModelCacheFolder(options.data_folder), {}})) {}

Status ModelStore::Compile(const std::string& environment, const std::string& file,
                           const Deadline& deadline, Completion done) {
  B4MRL_RETURN_IF_ERROR(FindEnvironment(environment).status());
  if (!IsModelFileName(file)) {
    return InvalidArgument("model", file, "the name of a file in the models folder");
  }
  if (thread_.backlog() >= limits::kMaxPendingModels) {
    return Status(StatusCode::kLimitExceeded,
                  fmt::format("{} models wait to be compiled", thread_.backlog()));
  }
  thread_.Submit([cache = cache_, environment, file, deadline, done = std::move(done)] {
    Result<std::string> path = cache->Compile(environment, file, deadline);
    if (path.ok()) path = CompiledModelPath(cache->folder, *path);
    return [path = std::move(path), done] { done(path); };
  });
  return Status();
}

}  // namespace b4mrl
