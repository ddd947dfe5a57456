#include "algorithms/nn/elementwise.h"

#include <algorithm>

#include "algorithms/nn/eigen_map.h"

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
      out[row] = z < 0 ? Scalar(0) : z;  // in this order NaN stays NaN
    }
  }
}

template <typename Scalar>
void AddBiasSwish(std::span<const Scalar> bias, MatrixView<Scalar> y, MatrixView<Scalar> slopes) {
  using Array = Eigen::Array<Scalar, Eigen::Dynamic, 1>;
  const ConstEigenColumn<Scalar> b(bias.data(), y.rows);
  // A strip that stays in the first-level cache between the passes below.
  constexpr int kStrip = 512;
  Eigen::Array<Scalar, Eigen::Dynamic, 1, 0, kStrip, 1> sigmoid;
  for (int column = 0; column < y.columns; ++column) {
    for (int first = 0; first < y.rows; first += kStrip) {
      const int count = std::min(kStrip, y.rows - first);
      Eigen::Map<Array> out(y.column(column) + first, count);
      out += b.segment(first, count);
      sigmoid = (Scalar(1) + (-out).exp()).inverse();
      out *= sigmoid;
      if (slopes.data != nullptr) {
        Eigen::Map<Array> slope(slopes.column(column) + first, count);
        slope = sigmoid + out * (Scalar(1) - sigmoid);
      }
    }
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
void TransposeInto(MatrixView<const Scalar> from, MatrixView<Scalar> to) {
  // Squares whose columns and rows both stay in the first-level cache.
  constexpr int kSquare = 8;
  for (int column = 0; column < from.columns; column += kSquare) {
    const int columns = std::min(kSquare, from.columns - column);
    for (int row = 0; row < from.rows; row += kSquare) {
      const int rows = std::min(kSquare, from.rows - row);
      const Scalar* __restrict in = from.column(column) + row;
      Scalar* __restrict out = to.column(row) + column;
      if (rows == kSquare && columns == kSquare) {
        for (int i = 0; i < kSquare; ++i) {
          for (int j = 0; j < kSquare; ++j) out[i * to.stride + j] = in[j * from.stride + i];
        }
      } else {
        for (int i = 0; i < rows; ++i) {
          for (int j = 0; j < columns; ++j) out[i * to.stride + j] = in[j * from.stride + i];
        }
      }
    }
  }
}

template <typename Scalar>
void RowSums(MatrixView<const Scalar> matrix, std::span<Scalar> sums) {
  // Strips of rows whose partial sums fit in registers.
  constexpr int kStrip = 64;
  for (int first = 0; first < matrix.rows; first += kStrip) {
    const int count = std::min(kStrip, matrix.rows - first);
    Scalar strip[kStrip] = {};
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
  template void TransposeInto<Scalar>(MatrixView<const Scalar>, MatrixView<Scalar>);              \
  template void RowSums<Scalar>(MatrixView<const Scalar>, std::span<Scalar>);
B4MRL_INSTANTIATE(float)
B4MRL_INSTANTIATE(double)
#undef B4MRL_INSTANTIATE

}  // namespace b4mrl
