// The compiled models of users (model=FILE.xml): has files compiled by sandboxed processes, and
// remembers the compiled model or the error for as long as the file's content does not change.
//
//   DATA/.b4mrl-cache/models/<hash>.mjb   compiled models, named by content, at most
//                                         kMaxCompiledModels; a session remembers its model's hash,
//                                         so a later change of FILE.xml changes no running session
//   DATA/.b4mrl-cache/models/.trial-*     models that are being compiled; what a killed gateway has
//                                         left is removed after the next compilation
//
// Any thread. Which file is compiled when is decided by server/process/preparation_queue.h.
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
  // Looks at no folder: one on a network may not answer.
  explicit ModelStore(Options options);

  // The path of the compiled model of `file` for `environment`. Where it is not known yet, waits
  // for a process that compiles it, at most limits::kModelCompilerMs. When `cancelled` turns true,
  // the process is ended within 100 ms: kUnavailable. Errors as in CompileModelInChild.
  Result<std::string> Compile(const std::string& environment, const std::string& file,
                              const std::atomic<bool>& cancelled);
  // Has the compiled models that were used longer ago removed before this one. False if it is gone.
  static bool MarkAsUsed(const std::string& path);

 private:
  struct Known {
    uint64_t content;
    Result<std::string> hash;  // or why the file is refused
  };
  std::optional<Result<std::string>> Recall(const std::string& environment, const std::string& file,
                                            uint64_t content);
  void Remember(const std::string& environment, const std::string& file, Known known);

  const Options options_;
  std::mutex mutex_;
  // By environment and file; at most limits::kMaxCompiledModels.
  std::map<std::pair<std::string, std::string>, Known> known_;
};

}  // namespace b4mrl
