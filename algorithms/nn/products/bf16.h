// Kernels of products of bf16 numbers with fp32 sums, for processors with AVX512-BF16.
//
// The processor multiplies pairs: two neighbours along the inner dimension, which is summed over,
// stand in one 32-bit lane, the first in the lower half. Factors are packed from fp32 into pairs;
// where the inner dimension is odd, the last pair's second number is 0. Rounding is to nearest,
// ties to even; numbers below the normal range become 0, NaN and infinity pass through. The order
// of sums is fixed by the shapes alone. Thread rule: pure functions. Call them only where HasBf16()
// (products/precision.h). Internal to nn/products.
#pragma once

#include <cstdint>

#include "algorithms/nn/products/view.h"

namespace b4mrl::bf16 {

using Pair = uint32_t;

// Pairs of a packed factor: pair k along the inner dimension, number i of the outer dimension, is
// data[k * inner_stride + i * outer_stride].
struct Pairs {
  const Pair* data;
  int inner;  // number of pairs along the inner dimension
  int64_t inner_stride;
  int64_t outer_stride;
};

// Pairs that a packed factor of outer x inner numbers needs, whatever its layout.
int64_t PackedSize(int outer, int inner);

// The inner dimension is the columns: pairs of two columns, lanes along the rows.
Pairs PackColumnPairs(MatrixView<const float> matrix, Pair* packed);
// The inner dimension is the rows: pairs within a column, columns one after the other. Serves as
// the second factor of Multiply only.
Pairs PackColumns(MatrixView<const float> matrix, Pair* packed);
// The inner dimension is the rows, as in PackColumns, but lanes run along the columns.
Pairs PackRowPairs(MatrixView<const float> matrix, Pair* packed);

// c(i, j) = sum over the inner dimension of a(i, .) b(., j). `a` has lanes along its outer
// dimension, that is outer_stride 1. a.inner == b.inner; a has c.rows and b c.columns numbers in
// the outer dimension.
void Multiply(const Pairs& a, const Pairs& b, MatrixView<float> c);

}  // namespace b4mrl::bf16
