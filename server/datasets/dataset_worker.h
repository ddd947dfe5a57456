// The process that serves datasets: List, Open, Stats, Sample and Read over the protocol.
//
// It never opens HDF5: a file is turned into a column cache by a short-lived importer process
// (importer.h), and only such caches are mapped, read-only. A corrupted dataset is another column
// cache, a pure function of (file hash, corruptions, seed). Both live in DATA/.cache/<fingerprint>,
// and Sample, Read and Stats name the fingerprint, so a worker that was killed and started again
// serves them with no other state.
//
// One thread receives, gathers straight into the reply's frame and sends. Another one lists and
// maps what is prepared, so that one client's Open does not hold up another's batches, not even
// where a replaced worker has to map their dataset again. Imports and derivations run side by side
// in two queues (preparation_queue.h), so that neither waits for the other, nor a small one for
// large ones. Requests for a dataset that is still being prepared wait for it, each at most its own
// deadline: wherever they wait, kDeadlineExceeded comes within 0.2 s of it.
//
// Datasets are DATA/<Environment>/<level>.h5, named "<Environment>/<level>", and
// DATA/d4rl/<name>.hdf5, named "d4rl/<name>".
#pragma once

#include <cstdint>
#include <string>

#include "proto/base/status.h"
#include "server/process/child.h"

namespace b4mrl {

struct DatasetWorkerOptions {
  // The program that knows `--role importer`, started once per new file.
  std::string importer_program = "/proc/self/exe";
  // Disk that all caches may take together. Beyond it the caches that nobody has mapped are
  // removed, those that were used longest ago first.
  uint64_t max_cache_bytes = 64ull << 30;
};

// The main function of the role "dataset-worker" (server/process/child.h). In a drain, requests
// that wait are answered kUnavailable.
Status RunDatasetWorker(ChildContext& context, const DatasetWorkerOptions& options = {});

}  // namespace b4mrl
