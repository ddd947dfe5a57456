// The process that serves datasets: ListDatasets, OpenDataset, DatasetStats, Sample and Read.
//
// It never opens HDF5: a short-lived importer process (importer.h) turns a file into a column
// cache, and the dataset worker maps such caches, read-only. A corrupted dataset is another column
// cache, a pure function of (rows, corruptions, seed). Both live in
// DATA/.b4mrl-cache/<fingerprint>, and Sample, Read and DatasetStats name the fingerprint, so a
// worker that was killed and started again serves them with no other state.
//
// One thread receives messages, gathers rows straight into the reply's frame and sends; a reply
// that takes long is filled in turns with others (server/batches/batch_turns.h). Threads of their
// own list files, open finished caches and map them again for a replaced worker, so that one
// client's Open does not hold up another client's batches. Imports and
// derivations run side by side in two queues (server/process/preparation_queue.h), so that neither
// waits for the other, nor a small one for a large one. A request for a dataset that is being
// prepared waits for it: kDeadlineExceeded comes within 0.2 s of the request's deadline.
//
// Datasets are DATA/<Environment>/<level>.h5, named "<Environment>/<level>", and
// DATA/d4rl/<name>.hdf5, named "d4rl/<name>".
#pragma once

#include <string>

#include "proto/base/status.h"
#include "server/process/child.h"

namespace b4mrl {

struct DatasetWorkerOptions {
  // The program that knows `--role importer`, started once per new file.
  std::string importer_program = "/proc/self/exe";
};

// The main function of the role "dataset-worker" (server/process/child.h). In a drain, requests
// that wait are answered kUnavailable.
Status RunDatasetWorker(ChildContext& context, const DatasetWorkerOptions& options = {});

}  // namespace b4mrl
