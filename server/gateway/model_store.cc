#include "server/gateway/model_store.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <xxhash.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <vector>

#include "data/files/atomic_file.h"
#include "data/files/cache_root.h"
#include "proto/base/limits.h"
#include "proto/base/unique_fd.h"
#include "server/environments/mujoco/compiled_model.h"
#include "server/models/model_compiler.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

// The names, sizes and times of a folder's files, as text. Nothing when the folder has too many.
std::optional<std::string> StateOfFolder(const std::string& folder) {
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
  return fmt::format("{}", fmt::join(entries, "\n"));
}

// A hash of all that the compilation of a file depends on: its bytes and, if they can name other
// files, the state of the folder. Nothing when the hash cannot be computed.
std::optional<uint64_t> ContentOf(const std::string& folder, const std::string& file) {
  // O_NONBLOCK, so that opening a pipe does not wait. The descriptor is read, not the path again,
  // as the path may name another file by then.
  const UniqueFd fd(open((folder + "/" + file).c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  struct stat info {};
  if (!fd.valid() || fstat(fd.get(), &info) != 0 || !S_ISREG(info.st_mode)) return std::nullopt;
  const Result<std::string> text =
      ReadSmallFile(fmt::format("/proc/self/fd/{}", fd.get()), limits::kMaxModelFileBytes);
  if (!text.ok()) return std::nullopt;
  std::string all = *text;
  // Includes, meshes, textures and the like are named by attributes called "file...".
  if (text->find("file") != std::string::npos) {
    const std::optional<std::string> others = StateOfFolder(folder);
    if (!others) return std::nullopt;
    all += *others;
  }
  return XXH3_64bits(all.data(), all.size());
}

// Whether compiling the same content again would end the same way. Errors that lie in the file are
// kept, since clients ask again and again; shortages of the machine are not.
bool IsLasting(const Result<std::string>& hash) {
  switch (hash.status().code()) {
    case StatusCode::kOk:
    case StatusCode::kInvalidArgument:
    case StatusCode::kUnsupported:
    case StatusCode::kDataLoss:  // the file ended the compiler or used up its processor time
      return true;
    default:
      return false;
  }
}

// Removes the compiled models that were used longest ago, and trials that are nobody's any more:
// those of other daemons that share the folder are younger.
void MakeRoom(const std::string& cache_folder) {
  const auto oldest_trial =
      fs::file_time_type::clock::now() - std::chrono::milliseconds(limits::kModelCompilerMs);
  std::vector<std::pair<fs::file_time_type, fs::path>> models;
  std::error_code error;
  for (fs::directory_iterator entry(cache_folder, error), end; !error && entry != end;
       entry.increment(error)) {
    std::error_code ignored;
    const fs::file_time_type used = entry->last_write_time(ignored);
    if (!entry->path().filename().string().starts_with(kTrialPrefix)) {
      models.emplace_back(used, entry->path());
    } else if (!ignored && used < oldest_trial) {
      fs::remove(entry->path(), ignored);
    }
  }
  if (models.size() <= limits::kMaxCompiledModels) return;
  std::ranges::sort(models);
  models.resize(models.size() - limits::kMaxCompiledModels);
  for (const auto& [used, path] : models) fs::remove(path, error);
}

}  // namespace

std::string ModelCacheFolder(const std::string& data_folder) {
  return CacheRoot(data_folder) + "/models";
}

ModelStore::ModelStore(Options options) : options_(std::move(options)) {}

bool ModelStore::MarkAsUsed(const std::string& path) {
  return utimensat(AT_FDCWD, path.c_str(), nullptr, 0) == 0;
}

Result<std::string> ModelStore::Compile(const std::string& environment, const std::string& file,
                                        const std::atomic<bool>& cancelled) {
  const std::string cache_folder = ModelCacheFolder(options_.data_folder);
  const auto path_of = [&](const Result<std::string>& hash) {
    return hash.ok() ? CompiledModelPath(cache_folder, *hash) : hash;
  };
  const std::optional<uint64_t> content = ContentOf(options_.models_folder, file);
  if (content) {
    if (const auto known = Recall(environment, file, *content)) {
      const Result<std::string> path = path_of(*known);
      // The model may have made room for others meanwhile.
      if (!path.ok() || MarkAsUsed(*path)) return path;
    }
  }
  B4MRL_RETURN_IF_ERROR(MakeCacheRoot(options_.data_folder));
  B4MRL_RETURN_IF_ERROR(MakeFolderInside(cache_folder));
  const Result<std::string> hash = CompileModelInChild(
      options_.program, {options_.models_folder, file, environment, cache_folder},
      Deadline::AfterMs(limits::kModelCompilerMs), &cancelled);
  if (hash.ok()) {
    MarkAsUsed(CompiledModelPath(cache_folder, *hash));
    MakeRoom(cache_folder);
  }
  // Changed while it was compiled: the next request compiles again.
  if (content && IsLasting(hash) && ContentOf(options_.models_folder, file) == content) {
    Remember(environment, file, {*content, hash});
  }
  return path_of(hash);
}

std::optional<Result<std::string>> ModelStore::Recall(const std::string& environment,
                                                      const std::string& file, uint64_t content) {
  const std::lock_guard lock(mutex_);
  const auto known = known_.find({environment, file});
  if (known == known_.end() || known->second.content != content) return std::nullopt;
  return known->second.hash;
}

void ModelStore::Remember(const std::string& environment, const std::string& file, Known known) {
  const std::lock_guard lock(mutex_);
  if (known_.size() >= limits::kMaxCompiledModels) known_.clear();
  known_.insert_or_assign({environment, file}, std::move(known));
}

}  // namespace b4mrl
