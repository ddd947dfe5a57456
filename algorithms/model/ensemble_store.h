// Training an ensemble so that no work is lost: it goes on where a killed run stopped, and a
// finished one serves every later run that would train the same.
//
//   <run folder>/ensemble.h5           its state every 1,000 updates, and at the end
//   <cache folder>/ensembles/<key>.h5  finished ones, of all runs
//
// The key is a hash of everything that the ensemble is a function of: all training columns (and so
// dataset, corruptions, simulator and the noise of its answers), options and seed, this program's
// version, and the whole state after the first update, in which another processor, BLAS kernel or
// compiler shows. A file carries its key and a hash of its state; what does not match is not used.
// The cache is bounded, the longest unused go first; nothing that goes wrong with it fails a run.
// Thread rule: one thread. Files appear complete or not at all, so processes may share the cache.
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
  uint64_t cache_bytes_max = 1ull << 30;  // some 70 ensembles of HalfCheetah
};

// Brings `ensemble`, as created, to the end of its training, or as far as it gets before `stop` is
// set; returns its key. kFailedPrecondition when the loss is not finite; kIoError when the run's
// file cannot be written.
Result<std::string> TrainEnsemble(const DynamicsData<float>& data, const EnsembleFiles& files,
                                  DynamicsEnsemble<float>& ensemble, Progress& progress,
                                  const std::atomic<bool>& stop);

// The finished one of that key, for a run that is resumed. kDataLoss when neither file has it.
Status LoadTrainedEnsemble(const std::string& key, const EnsembleFiles& files,
                           DynamicsEnsemble<float>& ensemble);

}  // namespace b4mrl
