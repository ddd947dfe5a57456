// What HyMOPO's ensemble learns from: for every row of a dataset, how far the simulator was off.
//
// The pre-pass reads the dataset in order and asks the simulator T_sim(o, a) for each row, draw 0,
// the row's own number naming its noise: one frozen pass. The target of a row is [o' - o'_sim, r].
// Both o and o' are what the daemon serves, so nothing that a corruption hides can enter. Rows that
// the simulator cannot answer are dropped and counted.
#pragma once

#include <cstdint>

#include "algorithms/learner.h"
#include "algorithms/nn/view.h"
#include "algorithms/rl/dynamics_ensemble.h"
#include "client/remote_dataset.h"
#include "client/remote_environment.h"

namespace b4mrl {

struct CorrectionData {
  MatrixBuffer<float> observations;  // columns are rows of the dataset, in order
  MatrixBuffer<float> actions;       // in [-1, 1]
  MatrixBuffer<float> targets;
  int rows = 0;  // valid ones: the leading columns
  uint64_t invalid_rows = 0;

  DynamicsData<float> view() const {
    return {observations.view(rows), actions.view(rows), targets.view(rows)};
  }
};

// `simulator`: a session of the simulator for queries; `query_seed` names its noise.
Result<CorrectionData> QueryCorrections(const LearnerContext& context, RemoteDataset& dataset,
                                        RemoteEnvironment& simulator, uint64_t query_seed,
                                        Progress& progress);

}  // namespace b4mrl
