// Trains dynamics ensembles without losing work: a killed training continues from its last file,
// and a trained ensemble serves every later run that would train an equal ensemble.
//
//   <run folder>/ensemble.h5             the run's ensemble, written every 1,000 updates and at the
//                                        end
//   <cache folder>/ensembles/<key>.h5    trained ensembles of all runs
//
// A file holds two hashes of what its ensemble depends on, and one of its state, with which it is
// checked. `inputs` covers all training columns (and so dataset, corruptions, simulator and the
// noise of its answers), options with the seed, and this program's version with the revision of its
// training rule. The key covers the state after the first update too, whose bits differ between
// processors, BLAS kernels and compilers. A run takes up its own file by the inputs, so that a run
// that moves to another kind of processor loses nothing; other runs' ensembles are taken by the
// key, thus only with the bits that their own training would give. An ensemble that was moved gets
// a key of its own and is not kept. The cache has a size limit, at which the least recently used
// ensembles are removed; one that alone exceeds it is not kept. An error in the cache never fails a
// run. Thread rule: one thread. Files appear complete or not at all, so processes may share the
// cache.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>

#include "algorithms/base/progress.h"
#include "algorithms/model/dynamics_ensemble.h"
#include "proto/base/status.h"

namespace b4mrl {

struct EnsembleFiles {
  std::string run_folder;
  std::string cache_folder;               // "": finished ensembles are neither kept nor reused
  uint64_t cache_bytes_max = 1ull << 30;  // size limit of the cache: about 70 of HalfCheetah
};

struct EnsembleTraining {
  std::string key;            // of the ensemble
  double seconds_before = 0;  // that earlier sessions of this run spent on it
};

// Trains `ensemble`, which was just created, to the end or until `stop` is set. kFailedPrecondition
// when the loss, or every member's hold-out error, is not finite; kIoError when the run's
// ensemble.h5 cannot be written.
Result<EnsembleTraining> TrainEnsemble(const DynamicsData<float>& data, const EnsembleFiles& files,
                                       DynamicsEnsemble<float>& ensemble, Progress& progress,
                                       const std::atomic<bool>& stop);

// Reads the trained ensemble with the key `key`, for a run that is resumed. kDataLoss when neither
// the run's folder nor the cache holds that ensemble.
Status LoadTrainedEnsemble(const std::string& key, const EnsembleFiles& files,
                           DynamicsEnsemble<float>& ensemble);

}  // namespace b4mrl
