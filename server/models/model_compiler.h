// Turns a user's MJCF file into a compiled model that simulators can trust to load, in a process of
// its own: MuJoCo's compiler crashes on crafted files, reads any path that they name, and takes all
// the memory and time that they ask for.
//
// The process gives up what it does not need (server/sandbox/sandbox.h), checks what the file
// refers to (server/models/model_scan.h), compiles it, and tries the result out in the environment
// it is meant for: joints and motors must fit, and a start and the first steps must end. Only then
// does MODELS_CACHE/<hash>.mjb appear, named by its content. Nothing else ever parses a user's
// model.
// Thread rule: RunModelCompiler is a process's main function; CompileModelInChild may be called by
// any one thread.
#pragma once

#include <atomic>
#include <string>
#include <string_view>
#include <vector>

#include "proto/base/clock.h"
#include "proto/base/status.h"

namespace b4mrl {

// How the names of files begin in which models are tried out. A file stays where the process that
// waits for the compiler is killed.
inline constexpr std::string_view kTrialPrefix = ".trial-";

struct ModelCompilerOptions {
  std::string models_folder;
  std::string file_name;     // in models_folder
  std::string environment;   // the task whose own model the file replaces
  std::string cache_folder;  // must exist
  // The file in cache_folder in which the model is tried out. CompileModelInChild draws a name, so
  // that daemons that share the folder, each with process ids of its own, use different files.
  std::string trial_name = "";
};

// `b4mrl-serve --role model-compiler --models DIR --file NAME --environment E --cache-folder DIR
// --trial NAME`. Exit code 0 when the model is in the cache, 3 otherwise.
int RunModelCompiler(const ModelCompilerOptions& options);

// Starts `program --role model-compiler ...` and waits. Returns the hash, which names the file in
// the cache. kUnknownName when there is no such file; kInvalidArgument with the file, its line
// where there is one, and the reason; kDataLoss when the file ended the process, kDeadlineExceeded;
// kUnavailable when `cancelled` (may be null) turned true.
Result<std::string> CompileModelInChild(const std::string& program,
                                        const ModelCompilerOptions& options,
                                        const Deadline& deadline,
                                        const std::atomic<bool>* cancelled = nullptr);

// The MJCF files of a folder that can be named in model=FILE.xml: sorted, at most
// limits::kMaxModelFiles.
std::vector<std::string> ListModelFiles(const std::string& models_folder);

}  // namespace b4mrl
