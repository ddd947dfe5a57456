// Turns one HDF5 dataset file into a column cache, in a process of its own: HDF5 1.10 is known to
// crash on crafted files, and such a crash must cost nothing but an error message.
//
// The process first gives up what it does not need: no core files, bounded memory, processor time,
// file size and descriptors, no new privileges, and (Linux 5.13 or later, Landlock) no access to
// the file system beyond reading the one file and writing into the one folder that was made for
// this import. Its limits on time and size follow the bytes that the file stores, without its
// holes; where a file of the cache would become too large, the answer is kLimitExceeded. It prints
// one JSON line on stdout:
//   {"ok": true, "rows": 1000000, "behaviour_policy": "SAC", "infers_timeouts": false,
//    "provenance": {...}}
//   {"ok": false, "code": 12, "message": "..."}
// The hashes of the file and of the columns are not taken from this process: a crafted file may
// control it. Thread rule: RunImporter is a process's main function; ImportInChild may be called by
// any thread.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>

#include "data/d4rl/import_dataset.h"
#include "proto/base/clock.h"
#include "proto/base/status.h"

namespace b4mrl {

struct ImporterOptions {
  std::string file;              // HDF5 in D4RL's layout
  std::string folder;            // exists, is empty; the cache appears as ImportedCachePath(folder)
  uint64_t max_cache_bytes = 0;  // the largest cache that may be made
};

std::string ImportedCachePath(const std::string& folder);

// `b4mrl-serve --role importer --file F --cache-folder DIR --cache-bytes N`. Exit code 0 when the
// cache stands, 3 on bad input, 1 otherwise.
int RunImporter(const ImporterOptions& options);

// kUnavailable: an import did not end in time, for which the file need not be to blame.
Status LateImport();

// Starts `program --role importer ...`, waits for it and returns what it says. A crash or a silent
// exit becomes a kDataLoss that names the file: asking again would not help. A missed deadline, at
// which the child is killed, is LateImport(). When `cancelled` (may be null) turns true, the child
// is killed within 100 ms: kUnavailable. The caller removes what a failed import leaves in the
// folder.
Result<ImportedDataset> ImportInChild(const std::string& program, const ImporterOptions& options,
                                      const Deadline& deadline,
                                      const std::atomic<bool>* cancelled = nullptr);

}  // namespace b4mrl
