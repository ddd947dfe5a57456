// Gives up what a process that parses untrusted files does not need. One-way, for the whole
// process; call it from the only thread.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "proto/base/status.h"

namespace b4mrl {

struct SandboxOptions {
  std::vector<std::string> readable_paths;  // the only files it may read; of a folder all in it
  std::string writable_folder;              // the only folder it may use
  uint64_t memory_bytes = 0;                // address space
  uint64_t cpu_seconds = 0;
  uint64_t file_bytes = 0;  // of each file that it writes
  uint64_t descriptors = 0;
};

// Resource limits, no core file, no new privileges, and file access confined by Landlock. Where the
// kernel has no Landlock (before 5.13, or switched off) the rest still holds and a warning is
// logged.
Status EnterSandbox(const SandboxOptions& options);

}  // namespace b4mrl
