// Eigen maps of MatrixViews, so that Eigen computes on them in place. Include in .cc files only.
// Never bind an Eigen expression to `auto`: it would refer to temporaries.
#pragma once

#include <Eigen/Core>
#include <initializer_list>

#include "algorithms/nn/products/view.h"

namespace b4mrl {

template <typename Scalar>
using EigenMatrix = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic>;
template <typename Scalar>
using EigenMap = Eigen::Map<EigenMatrix<Scalar>, 0, Eigen::OuterStride<>>;
template <typename Scalar>
using ConstEigenMap = Eigen::Map<const EigenMatrix<Scalar>, 0, Eigen::OuterStride<>>;
template <typename Scalar>
using EigenColumn = Eigen::Map<Eigen::Array<Scalar, Eigen::Dynamic, 1>>;
template <typename Scalar>
using ConstEigenColumn = Eigen::Map<const Eigen::Array<Scalar, Eigen::Dynamic, 1>>;

template <typename Scalar>
requires(!std::is_const_v<Scalar>) EigenMap<Scalar> ToEigen(MatrixView<Scalar> view) {
  return {view.data, view.rows, view.columns, Eigen::OuterStride<>(view.stride)};
}

template <typename Scalar>
ConstEigenMap<Scalar> ToEigen(MatrixView<const Scalar> view) {
  return {view.data, view.rows, view.columns, Eigen::OuterStride<>(view.stride)};
}

template <typename Scalar>
void CopyMatrix(MatrixView<const Scalar> from, MatrixView<Scalar> to) {
  ToEigen(to) = ToEigen(from);
}

// Writes `parts`, which have as many columns as `to`, into `to`, one below the other.
template <typename Scalar>
void StackRows(std::initializer_list<MatrixView<const Scalar>> parts, MatrixView<Scalar> to) {
  int row = 0;
  for (const MatrixView<const Scalar>& part : parts) {
    CopyMatrix<Scalar>(part, to.RowBlock(row, part.rows));
    row += part.rows;
  }
}

}  // namespace b4mrl
