// The one door to OpenBLAS.
//
// Eigen could forward products to BLAS itself (EIGEN_USE_BLAS), but always clears the destination
// and then accumulates; calling gemm saves that pass over every activation where OpenBLAS's kernels
// need none. Everything else that Eigen sends to BLAS goes through the same library.
//
// Thread rule: any thread, but a process calls UseOneBlasThread() once before its first product:
// learners are parallel by process, and the last bits of a product depend on how it is split.
#pragma once

#include <string>

#include "algorithms/nn/products/view.h"

namespace b4mrl {

void UseOneBlasThread();
// The kernel set OpenBLAS chose for this processor ("SkylakeX", "Zen", ...): part of an experiment
// record, since training is reproducible bit for bit only under the same one.
std::string BlasKernelName();

enum class Transpose : bool { kNo = false, kYes = true };

// How many columns of c = a op(b) to ask for at once, where c has `rows` rows and a `inner`
// columns; Multiply cuts products itself. 0: all at once. OpenBLAS's AVX-512 kernels multiply up to
// a million numbers (rows x columns x inner) without packing their operands or clearing c first,
// which is a tenth faster at the sizes of a learner; but only if a is not transposed, so that where
// this is not 0 a copy of a, transposed, pays. Depends on the processor, hence on nothing that
// changes in a run.
template <typename Scalar>
int NarrowProductColumns(int rows, int inner);

// c = op(a) op(b), or c += op(a) op(b). Shapes must agree; c overlaps neither a nor b.
template <typename Scalar>
void Multiply(MatrixView<const Scalar> a, Transpose transpose_a, MatrixView<const Scalar> b,
              Transpose transpose_b, MatrixView<Scalar> c, bool accumulate = false);

}  // namespace b4mrl
