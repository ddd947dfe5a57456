// Turns one HDF5 dataset file into a column cache, in a process of its own: HDF5 1.10 is known to
// crash on crafted files, and such a crash must cost nothing but an error message.
//
// The process first gives up what it does not need: no core files, bounded memory, processor time,
// file size and descriptors, no new privileges, and (Linux 5.13 or later, Landlock) no access to
// the file system beyond reading the one file and writing the one cache folder. It prints one JSON
// line on stdout:
//   {"ok": true, "fingerprint": "...", "rows": 1000000, "sha256": "..."}
//   {"ok": false, "code": 12, "message": "..."}
// Thread rule: RunImporter is a process's main function; ImportInChild may be called by any one
// thread.
#pragma once

#include <atomic>
#include <string>

#include "proto/base/clock.h"
#include "proto/base/status.h"

namespace b4mrl {

struct ImporterOptions {
  std::string file;          // HDF5 in D4RL's layout
  std::string cache_folder;  // must exist; the cache appears in it as a folder named by fingerprint
};

// `b4mrl-serve --role importer --file F --cache DIR`. Exit code 0 when the cache stands, 3 on bad
// input, 1 otherwise.
int RunImporter(const ImporterOptions& options);

struct ImportResult {
  std::string fingerprint;  // hex; names the cache folder
  std::string sha256;       // of the file
  uint64_t rows = 0;
};

// Starts `program --role importer ...`, waits for it and parses its answer. A crash, a silent exit
// or a missed deadline (the child is killed) becomes a kDataLoss or kDeadlineExceeded that names
// the file. When `cancelled` (may be null) turns true, the child is killed within 100 ms.
Result<ImportResult> ImportInChild(const std::string& program, const ImporterOptions& options,
                                   const Deadline& deadline,
                                   const std::atomic<bool>* cancelled = nullptr);

}  // namespace b4mrl
