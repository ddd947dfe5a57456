// The numbers behind a TransitionBatch: gathered rows, features x batch. Sized once. Thread rule:
// one thread. A view stays valid until the buffer is destroyed and shows whatever was written last.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>

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

  // Served rows, row-major, into columns from `first` on. Served actions are in the environment's
  // units, `scale`; here they are in [-1, 1].
  void SetObservations(std::span<const float> given, std::span<const float> next, int first = 0) {
    std::copy(given.begin(), given.end(), observations.view().column(first));
    std::copy(next.begin(), next.end(), next_observations.view().column(first));
  }
  void SetActions(std::span<const float> rows, std::span<const float> scale, int first = 0) {
    for (size_t i = 0; i < rows.size(); ++i) {
      const size_t row = i / scale.size(), dimension = i % scale.size();
      actions.view()(static_cast<int>(dimension), first + static_cast<int>(row)) =
          rows[i] / scale[dimension];
    }
  }
  void SetOutcomes(std::span<const float> given, std::span<const uint8_t> terminals,
                   int first = 0) {
    for (size_t i = 0; i < given.size(); ++i) {
      rewards[first + i] = given[i];
      not_terminated[first + i] = terminals[i] != 0 ? 0.0f : 1.0f;
    }
  }

  MatrixBuffer<float> observations;
  MatrixBuffer<float> actions;
  MatrixBuffer<float> next_observations;
  AlignedVector<float> rewards;
  AlignedVector<float> not_terminated;
};

}  // namespace b4mrl
