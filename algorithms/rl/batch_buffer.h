// The numbers behind a TransitionBatch: gathered rows, features x batch. Sized once. Thread rule:
// one thread. A view stays valid until the buffer is destroyed and shows whatever was written last.
#pragma once

#include "algorithms/nn/view.h"
#include "algorithms/rl/transition_batch.h"

namespace b4mrl {

struct BatchBuffer {
  BatchBuffer(int observation_size, int action_size, int batch)
      : observations(observation_size, batch),
        actions(action_size, batch),
        next_observations(observation_size, batch),
        rewards(batch),
        not_terminated(batch) {}

  TransitionBatch<float> view() const {
    return {observations.view(), actions.view(), rewards, next_observations.view(), not_terminated};
  }
  int size() const { return observations.columns(); }

  MatrixBuffer<float> observations;
  MatrixBuffer<float> actions;
  MatrixBuffer<float> next_observations;
  AlignedVector<float> rewards;
  AlignedVector<float> not_terminated;
};

}  // namespace b4mrl
