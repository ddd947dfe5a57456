#include "algorithms/nn/products/blas.h"

#include <cblas.h>

#include <algorithm>

namespace b4mrl {
namespace {

// From sgemm_small_matrix_permit of OpenBLAS 0.3.21, for SkylakeX and its successors: the largest
// product, in multiplications, that OpenBLAS gives to kernels without packing.
constexpr int64_t kSmallProduct = 1'000'000;
// Kernels without packing are fastest on whole groups of columns: groups of four columns if b is
// not transposed, of six if b is transposed.
constexpr int kColumnGroup = 12;
// Widest useful block, in columns: wider blocks are not faster, and c would leave the first-level
// cache before its next use.
constexpr int kNarrowMax = 8 * kColumnGroup;

bool HasKernelsWithoutPacking() {
  static const bool has = [] {
    const std::string name = BlasKernelName();
    return name == "SkylakeX" || name == "Cooperlake" || name == "SapphireRapids";
  }();
  return has;
}

CBLAS_TRANSPOSE ToCblas(Transpose transpose) {
  return transpose == Transpose::kYes ? CblasTrans : CblasNoTrans;
}

// y = op(a) x, with strides for vectors that are rows of a matrix.
void MatrixVector(Transpose transpose, MatrixView<const float> a, const float* x, int x_stride,
                  float* y, int y_stride) {
  cblas_sgemv(CblasColMajor, ToCblas(transpose), a.rows, a.columns, 1.0f, a.data, a.stride, x,
              x_stride, 0, y, y_stride);
}

void MatrixVector(Transpose transpose, MatrixView<const double> a, const double* x, int x_stride,
                  double* y, int y_stride) {
  cblas_dgemv(CblasColMajor, ToCblas(transpose), a.rows, a.columns, 1.0, a.data, a.stride, x,
              x_stride, 0, y, y_stride);
}

void MatrixMatrix(MatrixView<const float> a, Transpose transpose_a, MatrixView<const float> b,
                  Transpose transpose_b, int inner, float beta, MatrixView<float> c) {
  cblas_sgemm(CblasColMajor, ToCblas(transpose_a), ToCblas(transpose_b), c.rows, c.columns, inner,
              1.0f, a.data, a.stride, b.data, b.stride, beta, c.data, c.stride);
}

void MatrixMatrix(MatrixView<const double> a, Transpose transpose_a, MatrixView<const double> b,
                  Transpose transpose_b, int inner, double beta, MatrixView<double> c) {
  cblas_dgemm(CblasColMajor, ToCblas(transpose_a), ToCblas(transpose_b), c.rows, c.columns, inner,
              1.0, a.data, a.stride, b.data, b.stride, beta, c.data, c.stride);
}

template <typename Scalar>
void Clear(MatrixView<Scalar> c) {
  for (int i = 0; i < c.columns; ++i) {
    std::fill(c.column(i), c.column(i) + c.rows, Scalar(0));
  }
}

}  // namespace

void UseOneBlasThread() { openblas_set_num_threads(1); }

std::string BlasKernelName() { return openblas_get_corename(); }

template <>
int NarrowProductColumns<float>(int rows, int inner) {
  if (rows == 1 || !HasKernelsWithoutPacking()) return 0;  // one row is a matrix-vector product
  const int64_t columns = kSmallProduct / (static_cast<int64_t>(rows) * inner);
  return static_cast<int>(std::min<int64_t>(columns / kColumnGroup * kColumnGroup, kNarrowMax));
}

template <>
int NarrowProductColumns<double>(int, int) {
  return 0;
}

template <typename Scalar>
void Multiply(MatrixView<const Scalar> a, Transpose transpose_a, MatrixView<const Scalar> b,
              Transpose transpose_b, MatrixView<Scalar> c) {
  const bool a_flipped = transpose_a == Transpose::kYes;
  const bool b_flipped = transpose_b == Transpose::kYes;
  if (c.rows == 1) {
    // The row c is op(b)^T times the row op(a).
    MatrixVector(b_flipped ? Transpose::kNo : Transpose::kYes, b, a.data, a_flipped ? 1 : a.stride,
                 c.data, c.stride);
  } else if (c.columns == 1) {
    MatrixVector(transpose_a, a, b.data, b_flipped ? b.stride : 1, c.data, 1);
  } else {
    const int inner = a_flipped ? a.rows : a.columns;
    const int narrow = a_flipped ? 0 : NarrowProductColumns<Scalar>(c.rows, inner);
    const int step = narrow == 0 ? c.columns : narrow;
    Scalar beta = 0;
    if (!HasKernelsWithoutPacking()) {
      // Clear and beta 1 give the bits of beta 0, with which OpenBLAS clears c more slowly:
      // products with an inner size of 23 to 40 become 20% to 40% faster, of 200 and more some
      // percent.
      Clear(c);
      beta = 1;
    }
    for (int first = 0; first < c.columns; first += step) {
      const int count = std::min(step, c.columns - first);
      MatrixMatrix(a, transpose_a,
                   b_flipped ? b.RowBlock(first, count) : b.ColumnBlock(first, count), transpose_b,
                   inner, beta, c.ColumnBlock(first, count));
    }
  }
}

template void Multiply<float>(MatrixView<const float>, Transpose, MatrixView<const float>,
                              Transpose, MatrixView<float>);
template void Multiply<double>(MatrixView<const double>, Transpose, MatrixView<const double>,
                               Transpose, MatrixView<double>);

}  // namespace b4mrl
