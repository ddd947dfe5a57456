// Element-wise passes over activations and parameters between two matrix products, fused so that
// each pass touches memory once. Compiled with vectorisation (algorithms/CMakeLists.txt). A NaN in
// a forward pass's input stays in its output. Thread rule: pure functions. Internal to nn/.
#pragma once

#include <span>

#include "algorithms/nn/products/view.h"

namespace b4mrl {

// y += bias (per row).
template <typename Scalar>
void AddBias(std::span<const Scalar> bias, MatrixView<Scalar> y);

// y = max(y + bias, 0).
template <typename Scalar>
void AddBiasRelu(std::span<const Scalar> bias, MatrixView<Scalar> y);

// z = y + bias; y = z sigmoid(z); slopes = dy/dz (same shape; skipped when slopes.data is null).
template <typename Scalar>
void AddBiasSwish(std::span<const Scalar> bias, MatrixView<Scalar> y, MatrixView<Scalar> slopes);

// gradient = 0 where activation <= 0.
template <typename Scalar>
void ReluBackward(MatrixView<const Scalar> activation, MatrixView<Scalar> gradient);

// gradient(i, b) = column(i) row(b) where activation(i, b) > 0, else 0: ReLU's backward pass
// through a layer with one output, whose weights are `column`. row(b) is row_gradient[b *
// row_stride].
template <typename Scalar>
void ReluBackwardOuter(MatrixView<const Scalar> activation, const Scalar* column,
                       const Scalar* row_gradient, int row_stride, MatrixView<Scalar> gradient);

// gradient *= slopes.
template <typename Scalar>
void MultiplyInPlace(MatrixView<const Scalar> slopes, MatrixView<Scalar> gradient);

// sums += the sum of each row.
template <typename Scalar>
void AddRowSums(MatrixView<const Scalar> matrix, std::span<Scalar> sums);

}  // namespace b4mrl
