#include "algorithms/nn/products/left_factor.h"

#include <algorithm>
#include <type_traits>

#include "algorithms/nn/products/eigen_map.h"

namespace b4mrl {
namespace {

// Columns of c per block in bf16: with a hidden layer's width, the block and its part of b fit the
// second-level cache beside the packed factor, and the first-level cache holds most of the block.
constexpr int kBf16Columns = 48;

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wignored-attributes"  // Packet's alignment, in PacketBlock<Packet>

// to = from, transposed.
template <typename Scalar>
void TransposeInto(MatrixView<const Scalar> from, MatrixView<Scalar> to) {
  // Transposes square blocks of whole SIMD registers by shuffles; plain loops would be compiled to
  // moves of single numbers.
  using Packet = typename Eigen::internal::packet_traits<Scalar>::type;
  constexpr int kSquare = Eigen::internal::packet_traits<Scalar>::size;
  for (int column = 0; column < from.columns; column += kSquare) {
    const int columns = std::min(kSquare, from.columns - column);
    for (int row = 0; row < from.rows; row += kSquare) {
      const int rows = std::min(kSquare, from.rows - row);
      const Scalar* in = from.column(column) + row;
      Scalar* out = to.column(row) + column;
      if (rows < kSquare || columns < kSquare) {
        for (int i = 0; i < rows; ++i) {
          for (int j = 0; j < columns; ++j) out[i * to.stride + j] = in[j * from.stride + i];
        }
        continue;
      }
      Eigen::internal::PacketBlock<Packet, kSquare> square;
      for (int j = 0; j < kSquare; ++j) {
        square.packet[j] = Eigen::internal::ploadu<Packet>(in + j * from.stride);
      }
      Eigen::internal::ptranspose(square);
      for (int i = 0; i < kSquare; ++i) {
        Eigen::internal::pstoreu(out + i * to.stride, square.packet[i]);
      }
    }
  }
}

#pragma GCC diagnostic pop

}  // namespace

template <typename Scalar>
void ProductScratch<Scalar>::Reserve(Precision precision, int outer, int inner, int columns) {
  const auto reserve = [](auto& numbers, int64_t size) {
    if (std::ssize(numbers) < size) numbers.resize(size);
  };
  if (precision == Precision::kBf16) {
    reserve(left, bf16::PackedSize(outer, inner));
    reserve(right, bf16::PackedSize(columns, inner));
  } else {
    reserve(transposed, static_cast<int64_t>(outer) * inner);
  }
}

template <typename Scalar>
LeftFactor<Scalar>::LeftFactor(Precision precision, MatrixView<const Scalar> a, Transpose transpose,
                               ProductScratch<Scalar>& scratch)
    : precision_(precision), transpose_(transpose), a_(a), scratch_(&scratch) {
  const bool transposed = transpose == Transpose::kYes;
  if constexpr (std::is_same_v<Scalar, float>) {
    if (precision == Precision::kBf16) {
      bf16::Pair* packed = scratch.left.data();
      pairs_ = transposed ? bf16::PackRowPairs(a, packed) : bf16::PackColumnPairs(a, packed);
      return;
    }
  }
  if (transposed && NarrowProductColumns<Scalar>(a.columns, a.rows) > 0) {
    const MatrixView<Scalar> copy(scratch.transposed.data(), a.columns, a.rows);
    TransposeInto<Scalar>(a, copy);
    a_ = copy;
    transpose_ = Transpose::kNo;
  }
}

template <typename Scalar>
int LeftFactor<Scalar>::ColumnsAtOnce(int columns) const {
  if (precision_ == Precision::kBf16) return kBf16Columns;
  const bool transposed = transpose_ == Transpose::kYes;
  const int narrow = NarrowProductColumns<Scalar>(transposed ? a_.columns : a_.rows,
                                                  transposed ? a_.rows : a_.columns);
  return narrow > 0 ? narrow : columns;
}

template <typename Scalar>
void LeftFactor<Scalar>::Multiply(MatrixView<const Scalar> b, Transpose transpose,
                                  MatrixView<Scalar> c) const {
  if constexpr (std::is_same_v<Scalar, float>) {
    if (precision_ == Precision::kBf16) {
      bf16::Pair* packed = scratch_->right.data();
      bf16::Multiply(pairs_,
                     transpose == Transpose::kYes ? bf16::PackColumnPairs(b, packed)
                                                  : bf16::PackColumns(b, packed),
                     c);
      return;
    }
  }
  b4mrl::Multiply<Scalar>(a_, transpose_, b, transpose, c);
}

template struct ProductScratch<float>;
template struct ProductScratch<double>;
template class LeftFactor<float>;
template class LeftFactor<double>;

}  // namespace b4mrl
