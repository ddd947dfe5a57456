// The training rows of a dynamics ensemble: (o, a) and a target for every row of a dataset, in
// order.
//
//   MOPO    [o' - o, r]       the change of the observation
//   HyMOPO  [o' - o'_sim, r]  the simulator's error: a pre-pass queries o'_sim = T_sim(o, a) once
//                             for each row, with noise addressed by draw 0 and the row's number
// The daemon serves both o and o', so nothing that a corruption hides can enter. o' is the stored
// next observation, which at the end of an episode is not the next row; under the rule d4rl
// (data/columns/episodes.h) terminal rows have none. Rows without o', those whose simulation fails
// and those whose target is not finite are dropped and counted; if no row is left, the error is
// kFailedPrecondition. Numbers of the dataset that are not finite are kDataLoss, as in batches: a
// learner would meet them after hours.
#pragma once

#include <cstdint>

#include "algorithms/base/learner.h"
#include "algorithms/model/dynamics_ensemble.h"
#include "algorithms/nn/products/view.h"
#include "client/remote_dataset.h"
#include "client/remote_environment.h"

namespace b4mrl {

struct ModelData {
  MatrixBuffer<float> observations;  // columns are rows of the dataset, in order
  MatrixBuffer<float> actions;       // in [-1, 1]
  MatrixBuffer<float> targets;
  int rows = 0;               // number of valid rows, which are the leading columns
  uint64_t invalid_rows = 0;  // number of dropped rows

  DynamicsData<float> view() const {
    return {observations.view(rows), actions.view(rows), targets.view(rows)};
  }
};

// The training rows of MOPO.
Result<ModelData> ReadChanges(const LearnerContext& context, RemoteDataset& dataset,
                              Progress& progress);
// The training rows of HyMOPO. `simulator`: a session of the simulator for queries; `query_seed`:
// the seed of the simulator's noise.
Result<ModelData> QueryCorrections(const LearnerContext& context, RemoteDataset& dataset,
                                   RemoteEnvironment& simulator, uint64_t query_seed,
                                   Progress& progress);

}  // namespace b4mrl
