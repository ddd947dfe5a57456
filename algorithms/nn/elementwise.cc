#include "algorithms/nn/elementwise.h"

#include <algorithm>

#include "algorithms/nn/products/eigen_map.h"

namespace b4mrl {

template <typename Scalar>
void AddBias(std::span<const Scalar> bias, MatrixView<Scalar> y) {
  const Scalar* __restrict b = bias.data();
  for (int column = 0; column < y.columns; ++column) {
    Scalar* __restrict out = y.column(column);
    for (int row = 0; row < y.rows; ++row) out[row] += b[row];
  }
}

template <typename Scalar>
void AddBiasRelu(std::span<const Scalar> bias, MatrixView<Scalar> y) {
  const Scalar* __restrict b = bias.data();
  for (int column = 0; column < y.columns; ++column) {
    Scalar* __restrict out = y.column(column);
    for (int row = 0; row < y.rows; ++row) {
      const Scalar z = out[row] + b[row];
      out[row] = z < 0 ? Scalar(0) : z;  // keeps NaN, since NaN < 0 is false
    }
  }
}

namespace {

// Replaces `size` consecutive numbers z in `y` by z sigmoid(z).
template <typename Scalar>
void Swish(int64_t size, Scalar* y, Scalar* slopes) {
  using Array = Eigen::Array<Scalar, Eigen::Dynamic, 1>;
  // A strip that stays in the first-level cache between the passes below.
  constexpr int kStrip = 512;
  Eigen::Array<Scalar, Eigen::Dynamic, 1, 0, kStrip, 1> sigmoid;
  for (int64_t first = 0; first < size; first += kStrip) {
    const int64_t count = std::min<int64_t>(kStrip, size - first);
    Eigen::Map<Array> out(y + first, count);
    sigmoid = (Scalar(1) + (-out).exp()).inverse();
    out *= sigmoid;
    if (slopes == nullptr) continue;
    Eigen::Map<Array>(slopes + first, count) = sigmoid + out * (Scalar(1) - sigmoid);
  }
}

}  // namespace

template <typename Scalar>
void AddBiasSwish(std::span<const Scalar> bias, MatrixView<Scalar> y, MatrixView<Scalar> slopes) {
  AddBias<Scalar>(bias, y);
  if (y.dense() && (slopes.data == nullptr || slopes.dense())) {
    Swish<Scalar>(static_cast<int64_t>(y.rows) * y.columns, y.data, slopes.data);
    return;
  }
  for (int column = 0; column < y.columns; ++column) {
    Swish<Scalar>(y.rows, y.column(column),
                  slopes.data == nullptr ? nullptr : slopes.column(column));
  }
}

template <typename Scalar>
void ReluBackward(MatrixView<const Scalar> activation, MatrixView<Scalar> gradient) {
  for (int column = 0; column < gradient.columns; ++column) {
    const Scalar* __restrict a = activation.column(column);
    Scalar* __restrict g = gradient.column(column);
    for (int row = 0; row < gradient.rows; ++row) g[row] = a[row] > 0 ? g[row] : Scalar(0);
  }
}

template <typename Scalar>
void ReluBackwardOuter(MatrixView<const Scalar> activation, const Scalar* column_weights,
                       const Scalar* row_gradient, int row_stride, MatrixView<Scalar> gradient) {
  const Scalar* __restrict w = column_weights;
  for (int column = 0; column < gradient.columns; ++column) {
    const Scalar scale = row_gradient[static_cast<std::ptrdiff_t>(column) * row_stride];
    const Scalar* __restrict a = activation.column(column);
    Scalar* __restrict g = gradient.column(column);
    for (int row = 0; row < gradient.rows; ++row) g[row] = a[row] > 0 ? w[row] * scale : Scalar(0);
  }
}

template <typename Scalar>
void MultiplyInPlace(MatrixView<const Scalar> slopes, MatrixView<Scalar> gradient) {
  for (int column = 0; column < gradient.columns; ++column) {
    const Scalar* __restrict s = slopes.column(column);
    Scalar* __restrict g = gradient.column(column);
    for (int row = 0; row < gradient.rows; ++row) g[row] *= s[row];
  }
}

template <typename Scalar>
void AddRowSums(MatrixView<const Scalar> matrix, std::span<Scalar> sums) {
  // Strips of rows whose partial sums fit in registers.
  constexpr int kStrip = 64;
  for (int first = 0; first < matrix.rows; first += kStrip) {
    const int count = std::min(kStrip, matrix.rows - first);
    Scalar strip[kStrip] = {};
    std::copy_n(sums.begin() + first, count, strip);
    for (int column = 0; column < matrix.columns; ++column) {
      const Scalar* __restrict values = matrix.column(column) + first;
      if (count == kStrip) {
        for (int row = 0; row < kStrip; ++row) strip[row] += values[row];
      } else {
        for (int row = 0; row < count; ++row) strip[row] += values[row];
      }
    }
    std::copy(strip, strip + count, sums.begin() + first);
  }
}

#define B4MRL_INSTANTIATE(Scalar)                                                                 \
  template void AddBias<Scalar>(std::span<const Scalar>, MatrixView<Scalar>);                     \
  template void AddBiasRelu<Scalar>(std::span<const Scalar>, MatrixView<Scalar>);                 \
  template void AddBiasSwish<Scalar>(std::span<const Scalar>, MatrixView<Scalar>,                 \
                                     MatrixView<Scalar>);                                         \
  template void ReluBackward<Scalar>(MatrixView<const Scalar>, MatrixView<Scalar>);               \
  template void ReluBackwardOuter<Scalar>(MatrixView<const Scalar>, const Scalar*, const Scalar*, \
                                          int, MatrixView<Scalar>);                               \
  template void MultiplyInPlace<Scalar>(MatrixView<const Scalar>, MatrixView<Scalar>);            \
  template void AddRowSums<Scalar>(MatrixView<const Scalar>, std::span<Scalar>);
B4MRL_INSTANTIATE(float)
B4MRL_INSTANTIATE(double)
#undef B4MRL_INSTANTIATE

}  // namespace b4mrl
