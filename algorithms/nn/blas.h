// The one door to OpenBLAS.
//
// Eigen could forward products to BLAS itself (EIGEN_USE_BLAS), but always clears the destination
// and then accumulates; calling gemm saves that pass over every activation. Everything else that
// Eigen sends to BLAS goes through the same library. Thread rule: any thread, but a process calls
// UseOneBlasThread() once before its first product: learners are parallel by process, and the last
// bits of a product depend on how it is split.
#pragma once

#include <string>

#include "algorithms/nn/view.h"

namespace b4mrl {

void UseOneBlasThread();
// The kernel set OpenBLAS chose for this processor ("SkylakeX", "Zen", ...): part of an experiment
// record, since training is reproducible bit for bit only under the same one.
std::string BlasKernelName();

enum class Transpose : bool { kNo = false, kYes = true };

// c = op(a) op(b), or c += op(a) op(b). Shapes must agree; c overlaps neither a nor b.
template <typename Scalar>
void Multiply(MatrixView<const Scalar> a, Transpose transpose_a, MatrixView<const Scalar> b,
              Transpose transpose_b, MatrixView<Scalar> c, bool accumulate = false);

}  // namespace b4mrl
