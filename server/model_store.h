// The gateway's side of model=FILE.xml: has files compiled by sandboxed processes without waiting
// for them, and remembers the results while the models folder stays as it is.
//
//   DATA/.cache/models/<hash>.mjb   compiled models, named by content, at most kMaxCompiledModels;
//                                   a session remembers its hash, so a later change of FILE.xml
//                                   changes no running session
//
// Thread rule: the gateway's main thread, which calls RunCompletions when fd() is readable.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>

#include "proto/base/clock.h"
#include "proto/base/status.h"
#include "server/background_thread.h"

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

  // Runs on the calling thread of RunCompletions; the path of the compiled model.
  using Completion = std::function<void(const Result<std::string>&)>;
  // Compiles FILE for an environment, one file after another. An error is told at once: unknown
  // environments, names that no file can have, kLimitExceeded when limits::kMaxPendingModels wait.
  Status Compile(const std::string& environment, const std::string& file, const Deadline& deadline,
                 Completion done);

  bool idle() const { return thread_.backlog() == 0; }
  int fd() const { return thread_.fd(); }
  void RunCompletions() { thread_.RunCompletions(); }

 private:
  struct Cache;
  std::shared_ptr<Cache> cache_;  // the background thread's alone
  BackgroundThread thread_;
};

}  // namespace b4mrl
