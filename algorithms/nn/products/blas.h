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

// The widest block of columns of c = a op(b) that OpenBLAS multiplies without packing its operands,
// where c has `rows` rows and a has `inner` columns; 0 if this processor has no such kernel. Where
// it is not 0, transpose a first if need be (these kernels take no transposed a) and multiply block
// by block: a tenth faster at a learner's sizes. Multiply cuts its products into such blocks
// itself; callers ask so that they can process a block while it is in the cache. The limit is a
// million multiplications (rows x columns x inner) in OpenBLAS's AVX-512 kernels. It depends on the
// processor alone, so it never changes in a run.
template <typename Scalar>
int NarrowProductColumns(int rows, int inner);

// c = op(a) op(b), or c += op(a) op(b). Shapes must agree; c overlaps neither a nor b.
template <typename Scalar>
void Multiply(MatrixView<const Scalar> a, Transpose transpose_a, MatrixView<const Scalar> b,
              Transpose transpose_b, MatrixView<Scalar> c, bool accumulate = false);

}  // namespace b4mrl
