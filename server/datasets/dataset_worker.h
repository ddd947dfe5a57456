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

#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

#include "proto/base/status.h"
#include "proto/wire/socket.h"

namespace b4mrl {

struct DatasetWorkerOptions {
  std::vector<ListeningEndpoint> endpoints;  // the supervisor's listening descriptors
  std::string data_folder;
  // The program that knows `--role importer`, started once per new file.
  std::string importer_program = "/proc/self/exe";
  // Disk that all caches may take together; of those that nobody has mapped, those that were used
  // longest ago go.
  uint64_t max_cache_bytes = 64ull << 30;

  // Owned by the caller; each may be null. `heartbeat` grows at least every 200 ms while the
  // process is well. `drain` is set by SIGTERM: requests that wait are answered kUnavailable, then
  // Run returns.
  std::atomic<uint64_t>* heartbeat = nullptr;
  std::atomic<uint64_t>* requests = nullptr;
  std::atomic<uint64_t>* errors = nullptr;
  const std::atomic<bool>* drain = nullptr;
};

// Serves until `drain`. Returns the process's exit code: 0 after a drain, 1 when it cannot listen.
int RunDatasetWorker(const DatasetWorkerOptions& options);

}  // namespace b4mrl
