// The project's only calls of OpenBLAS.
//
// Eigen could forward products to BLAS itself (EIGEN_USE_BLAS), but it always clears the
// destination and then accumulates; calling gemm saves this pass over every activation where
// OpenBLAS's kernels do not need it. Everything else that Eigen sends to BLAS goes through the same
// library.
//
// Thread rule: any thread, but a process calls UseOneBlasThread() once before its first product:
// learners are parallel by process, and the last bits of a product depend on how it is split among
// threads.
#pragma once

#include <string>

#include "algorithms/nn/products/view.h"

namespace b4mrl {

void UseOneBlasThread();
// The kernel set that OpenBLAS chose for this processor ("SkylakeX", "Zen", ...). Run records store
// it, since training is reproducible bit for bit only with equal kernel sets.
std::string BlasKernelName();

enum class Transpose : bool { kNo = false, kYes = true };

// The widest block of columns of c = a op(b) that OpenBLAS multiplies without packing its operands,
// where c has `rows` rows and a has `inner` columns; 0 if this processor has no such kernel. If the
// width is not 0, a product is a tenth faster at a learner's sizes when a is not transposed
// (transpose it first: these kernels take no transposed a) and blocks are multiplied one by one.
// Multiply cuts its products into such blocks itself; a caller needs the width only to process each
// block while it is in the cache. The kernels' limit is a million multiplications (rows x columns x
// inner) with AVX-512. The width depends on the processor alone, so it never changes in a run.
template <typename Scalar>
int NarrowProductColumns(int rows, int inner);

// c = op(a) op(b). Shapes must agree; c overlaps neither a nor b.
template <typename Scalar>
void Multiply(MatrixView<const Scalar> a, Transpose transpose_a, MatrixView<const Scalar> b,
              Transpose transpose_b, MatrixView<Scalar> c);

}  // namespace b4mrl
