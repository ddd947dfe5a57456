// A batch of transitions as every core's Update takes it: views of features x batch matrices that
// the caller owns. HybridBatch is a batch whose rows come from two sources. Value types; no thread
// rule.
#pragma once

#include <span>

#include "algorithms/nn/products/view.h"

namespace b4mrl {

template <typename Scalar>
struct TransitionBatch {
  MatrixView<const Scalar> observations;       // observation size x batch
  MatrixView<const Scalar> actions;            // action size x batch, in [-1, 1]
  std::span<const Scalar> rewards;             // batch
  MatrixView<const Scalar> next_observations;  // observation size x batch
  // 1 - terminated. It is 1 for a truncated transition, since the value of s' still counts in y.
  std::span<const Scalar> not_terminated;  // batch

  int size() const { return observations.columns; }
  TransitionBatch Columns(int first, int count) const {
    return {observations.ColumnBlock(first, count), actions.ColumnBlock(first, count),
            rewards.subspan(first, count), next_observations.ColumnBlock(first, count),
            not_terminated.subspan(first, count)};
  }
};

// Transitions of the real dynamics, then transitions of a simulator; at least one of each kind.
template <typename Scalar>
struct HybridBatch {
  TransitionBatch<Scalar> rows;
  int real_rows = 0;

  int simulated_rows() const { return rows.size() - real_rows; }
  TransitionBatch<Scalar> simulated() const { return rows.Columns(real_rows, simulated_rows()); }
};

}  // namespace b4mrl
