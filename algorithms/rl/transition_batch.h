// A batch of transitions as every update takes it: views, features x batch, owned by the caller.
#pragma once

#include <span>

#include "algorithms/nn/view.h"

namespace b4mrl {

template <typename Scalar>
struct TransitionBatch {
  MatrixView<const Scalar> observations;       // observation size x batch
  MatrixView<const Scalar> actions;            // action size x batch, in [-1, 1]
  std::span<const Scalar> rewards;             // batch
  MatrixView<const Scalar> next_observations;  // observation size x batch
  // 1 - terminated. A truncated transition keeps 1: its value still bootstraps.
  std::span<const Scalar> not_terminated;  // batch

  int size() const { return observations.columns; }
};

}  // namespace b4mrl
