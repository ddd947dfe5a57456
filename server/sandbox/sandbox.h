// Takes from a process that parses untrusted files the rights that it does not need. This cannot be
// undone and holds for the whole process. Thread rule: the process's only thread.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "proto/base/status.h"

namespace b4mrl {

struct SandboxOptions {
  std::vector<std::string> readable_paths;  // the files, and folders of files, that it may read
  std::string writable_folder;              // the only folder that it may write to
  uint64_t memory_bytes = 0;                // address space
  uint64_t cpu_seconds = 0;
  uint64_t file_bytes = 0;  // of each file that it writes
  uint64_t descriptors = 0;
  bool alone = false;  // starts no thread and no process; not enforced for root
};

// Sets resource limits, forbids core files and new privileges, and confines file access by
// Landlock. Where the kernel has no Landlock (before 5.13, or switched off) a warning is logged and
// the rest still holds.
Status EnterSandbox(const SandboxOptions& options);

}  // namespace b4mrl
