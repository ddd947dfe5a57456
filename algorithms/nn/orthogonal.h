// Orthogonal initial weights (Saxe et al. 2014): Initialization::kOrthogonal of nn/mlp_layout.h.
#pragma once

#include <span>

#include "algorithms/nn/mlp_layout.h"
#include "proto/base/rng.h"

namespace b4mrl {

// Each member's weight of each layer becomes `gain` times a random matrix whose rows or, if it has
// more rows than columns, columns are orthonormal; all such matrices are equally likely. Biases
// become zero.
template <typename Scalar>
void InitializeOrthogonal(const MlpLayout& layout, double gain, Rng& rng,
                          std::span<Scalar> parameters);

}  // namespace b4mrl
