// The compiled models of users (model=FILE.xml): has files compiled by sandboxed processes, and
// remembers what came of it while a file's content stays as it is, whether it was taken or refused.
//
//   DATA/.cache/models/<hash>.mjb   compiled models, named by content, at most kMaxCompiledModels;
//                                   a session remembers its hash, so a later change of FILE.xml
//                                   changes no running session
//
// Any thread. Which file is compiled when is decided by server/gateway/model_queue.h.
#pragma once

#include <atomic>
#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include "proto/base/status.h"

namespace b4mrl {

// The folder of compiled models that belongs to a data folder.
std::string ModelCacheFolder(const std::string& data_folder);

class ModelStore {
 public:
  struct Options {
    std::string models_folder;
    std::string data_folder;
    std::string program = "/proc/self/exe";  // knows `--role model-compiler`
  };
  explicit ModelStore(Options options);

  // The path of FILE's compiled model for an environment. Waits for a process of at most
  // limits::kModelCompilerMs, unless the answer is known. `cancelled` turning true ends it within
  // 100 ms with kUnavailable. Errors as in CompileModelInChild.
  Result<std::string> Compile(const std::string& environment, const std::string& file,
                              const std::atomic<bool>& cancelled);

 private:
  struct Known {
    uint64_t content;
    Result<std::string> hash;  // or why the file is refused
  };
  std::optional<Result<std::string>> Recall(const std::string& environment, const std::string& file,
                                            uint64_t content);
  void Remember(const std::string& environment, const std::string& file, Known known);

  const Options options_;
  const std::string cache_folder_;
  std::mutex mutex_;
  // By environment and file; at most limits::kMaxCompiledModels.
  std::map<std::pair<std::string, std::string>, Known> known_;
};

}  // namespace b4mrl
