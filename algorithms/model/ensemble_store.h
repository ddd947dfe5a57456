// Trains dynamics ensembles without losing work: training that was killed goes on where its file
// stopped, and a trained ensemble serves every later run that would train the same one.
//
//   <run folder>/ensemble.h5           the run's ensemble, every 1,000 updates and at the end
//   <cache folder>/ensembles/<key>.h5  trained ensembles of all runs
//
// The key is a hash of everything that a trained ensemble depends on: all training columns (and so
// dataset, corruptions, simulator and the noise of its answers), options and seed, this program's
// version, and the state after the first update. Another processor, BLAS kernel or compiler gives
// other bits there, and so another key. A file holds its key and a hash of its state and is used
// only if both match. The cache has a size limit, at which the ensembles unused for longest are
// removed; an error in the cache never fails a run. Thread rule: one thread. Files appear complete
// or not at all, so processes may share the cache.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>

#include "algorithms/base/progress.h"
#include "algorithms/model/dynamics_ensemble.h"
#include "proto/base/status.h"

namespace b4mrl {

// $XDG_CACHE_HOME/b4mrl, otherwise $HOME/.cache/b4mrl; "" when neither is set.
std::string DefaultCacheFolder();

struct EnsembleFiles {
  std::string run_folder;
  std::string cache_folder;               // "": finished ensembles are neither kept nor reused
  uint64_t cache_bytes_max = 1ull << 30;  // about 70 ensembles of HalfCheetah
};

// Trains `ensemble`, which was just created, to the end or until `stop` is set; returns its key.
// kFailedPrecondition when the loss is not finite; kIoError when the run's file cannot be written.
Result<std::string> TrainEnsemble(const DynamicsData<float>& data, const EnsembleFiles& files,
                                  DynamicsEnsemble<float>& ensemble, Progress& progress,
                                  const std::atomic<bool>& stop);

// Reads the trained ensemble of that key for a run that is resumed. kDataLoss when neither the
// run's folder nor the cache has it.
Status LoadTrainedEnsemble(const std::string& key, const EnsembleFiles& files,
                           DynamicsEnsemble<float>& ensemble);

}  // namespace b4mrl
