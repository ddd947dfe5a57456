// Products c = op(a) b or op(a) b^T, block by block of c's columns: `a` is prepared once, in fp32
// or in bf16, and then multiplied by one block of b after the other, so that the caller's next pass
// over a block of c finds it in the cache. Thread rule: one thread; a factor owns nothing and lives
// no longer than its scratch and its matrix.
#pragma once

#include "algorithms/nn/products/bf16.h"
#include "algorithms/nn/products/blas.h"
#include "algorithms/nn/products/precision.h"
#include "algorithms/nn/products/view.h"

namespace b4mrl {

// Memory for both factors of one product at a time.
template <typename Scalar>
struct ProductScratch {
  // Makes the memory suffice for products of outer x inner by inner x columns numbers, transposed
  // or not.
  void Reserve(Precision precision, int outer, int inner, int columns);

  AlignedVector<Scalar> transposed;
  AlignedVector<bf16::Pair> left, right;
};

template <typename Scalar>
class LeftFactor {
 public:
  // Prepares `a` in `scratch`, where the next factor replaces it. kBf16: on processors with
  // HasBf16() alone, and with Scalar float.
  LeftFactor(Precision precision, MatrixView<const Scalar> a, Transpose transpose,
             ProductScratch<Scalar>& scratch);

  // The most columns of c, of `columns`, that are worth computing at once.
  int ColumnsAtOnce(int columns) const;
  // c = op(a) op(b). Shapes must agree; c overlaps neither a nor b.
  void Multiply(MatrixView<const Scalar> b, Transpose transpose, MatrixView<Scalar> c) const;

 private:
  Precision precision_;
  Transpose transpose_;
  MatrixView<const Scalar> a_;  // in fp32
  bf16::Pairs pairs_;           // in bf16
  ProductScratch<Scalar>* scratch_;
};

extern template struct ProductScratch<float>;
extern template struct ProductScratch<double>;
extern template class LeftFactor<float>;
extern template class LeftFactor<double>;

}  // namespace b4mrl
