// Packing of narrow column blocks, so that element-wise mathematics fills whole SIMD registers.
//
// Actions and observations have few dimensions: one column is shorter than a register, or does not
// fill its last register. Several columns are therefore packed side by side into one strip on the
// stack, and Eigen's vectorised functions run over the strip. Thread rule: pure functions. Internal
// to nn/.
#pragma once

#include <algorithm>
#include <span>

#include "algorithms/nn/products/eigen_map.h"

namespace b4mrl {

inline constexpr int kStripMax = 1024;  // numbers: 4 kB of floats, so several strips fit L1

template <typename Scalar>
using Strip = Eigen::Array<Scalar, Eigen::Dynamic, 1, 0, kStripMax, 1>;

// Number of columns of `rows` <= kStripMax numbers that fit into one strip.
inline int ColumnsPerStrip(int rows) { return std::max(1, kStripMax / rows); }

template <typename Scalar>
void Pack(MatrixView<const Scalar> block, Strip<Scalar>& strip) {
  strip.resize(block.rows * block.columns);
  CopyMatrix<Scalar>(block, {strip.data(), block.rows, block.columns});
}

template <typename Scalar>
void Unpack(const Strip<Scalar>& strip, MatrixView<Scalar> block) {
  CopyMatrix<Scalar>({strip.data(), block.rows, block.columns}, block);
}

// Fills `strip` with `columns` copies of `column`.
template <typename Scalar>
void Tile(std::span<const Scalar> column, int columns, Strip<Scalar>& strip) {
  const int rows = static_cast<int>(column.size());
  strip.resize(rows * columns);
  for (int i = 0; i < columns; ++i) {
    std::copy(column.begin(), column.end(), strip.data() + i * rows);
  }
}

}  // namespace b4mrl
