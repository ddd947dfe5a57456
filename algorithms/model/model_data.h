// The training rows of a dynamics ensemble: (o, a) and a target for every row of a dataset, in
// order.
//
//   MOPO    [o' - o, r]       the change of the observation
//   HyMOPO  [o' - o'_sim, r]  the simulator's error: a pre-pass asks for o'_sim = T_sim(o, a) of
//   each
//                             row once, with noise named by draw 0 and the row's number
// Both o and o' are what the daemon serves, so nothing that a corruption hides can enter; o' is the
// stored next observation, which at the end of an episode is not the next row. Rows whose target is
// not finite, or that the simulator cannot answer, are dropped and counted; if no row is left, the
// error is kFailedPrecondition.
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
  int rows = 0;  // valid ones: the leading columns
  uint64_t invalid_rows = 0;

  DynamicsData<float> view() const {
    return {observations.view(rows), actions.view(rows), targets.view(rows)};
  }
};

// The training rows of MOPO.
Result<ModelData> ReadChanges(const LearnerContext& context, RemoteDataset& dataset,
                              Progress& progress);
// The training rows of HyMOPO. `simulator`: a session of the simulator for queries; `query_seed`
// names its noise.
Result<ModelData> QueryCorrections(const LearnerContext& context, RemoteDataset& dataset,
                                   RemoteEnvironment& simulator, uint64_t query_seed,
                                   Progress& progress);

}  // namespace b4mrl
