// Memory of a TransitionBatch: its matrices have a column for each transition. Sized once. A view
// stays valid until the buffer is destroyed and shows the numbers written last. Thread rule: one
// thread.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>

#include "algorithms/cores/transition_batch.h"
#include "algorithms/nn/products/view.h"
#include "client/remote_dataset.h"

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

  // Writes the first columns of `actions`, in [-1, 1], from served actions `rows`, which are
  // row-major and in the environment's units; `scale` holds the largest action of each dimension.
  void SetActions(std::span<const float> rows, std::span<const float> scale) {
    for (size_t i = 0; i < rows.size(); ++i) {
      const size_t row = i / scale.size(), dimension = i % scale.size();
      actions.view()(static_cast<int>(dimension), static_cast<int>(row)) =
          rows[i] / scale[dimension];
    }
  }
  // Clips the actions of the first `count` columns to [-1, 1].
  void ClipActions(size_t count) {
    const auto clipped =
        std::span<float>(actions.values()).first(count * static_cast<size_t>(actions.rows()));
    for (float& action : clipped) action = std::clamp(action, -1.0f, 1.0f);
  }
  void SetOutcomes(std::span<const float> given, std::span<const uint8_t> terminals) {
    for (size_t i = 0; i < given.size(); ++i) {
      rewards[i] = given[i];
      not_terminated[i] = terminals[i] != 0 ? 0.0f : 1.0f;
    }
  }
  // Writes the first `count` columns from the served rows [first, first + count).
  void SetRows(const TransitionRows& rows, size_t first, size_t count,
               std::span<const float> scale) {
    const size_t size = static_cast<size_t>(observations.rows());
    const std::span<const float> given = rows.observations.subspan(first * size, count * size);
    const std::span<const float> next = rows.next_observations.subspan(first * size, count * size);
    std::copy(given.begin(), given.end(), observations.view().data);
    std::copy(next.begin(), next.end(), next_observations.view().data);
    SetActions(rows.actions.subspan(first * scale.size(), count * scale.size()), scale);
    SetOutcomes(rows.rewards.subspan(first, count), rows.terminals.subspan(first, count));
  }

  MatrixBuffer<float> observations;
  MatrixBuffer<float> actions;
  MatrixBuffer<float> next_observations;
  AlignedVector<float> rewards;
  AlignedVector<float> not_terminated;
};

}  // namespace b4mrl
