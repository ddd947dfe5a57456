// Which of OpenBLAS's kernel sets a program runs on.
//
// OpenBLAS goes by the processor's model number and, for one that is newer than itself, falls back
// to its oldest set, Prescott, with a fraction of the speed. The instruction sets say what it could
// have chosen.
#pragma once

#include <string_view>

namespace b4mrl {

// Those of this processor that kernel sets need, as far as the operating system lets them be used.
struct VectorInstructions {
  bool avx2_fma = false;
  bool avx512 = false;  // F, CD, BW, DQ and VL
  bool avx512_bf16 = false;

  static VectorInstructions OfThisProcessor();
};

// The set to ask for (OPENBLAS_CORETYPE) in place of `chosen`, by the rule that OpenBLAS has for
// processors that it knows; "" if `chosen` is no fallback or is the best there is. Pure; any
// thread.
std::string_view BetterBlasKernels(std::string_view chosen, const VectorInstructions& has);

// Starts this program anew with the better set, as OpenBLAS chooses before `main`; returns if there
// is none, or if OPENBLAS_CORETYPE was set by the user, whose word counts. The first call of
// `main`, with its `argv`.
void RestartWithBetterBlasKernels(char** argv);

}  // namespace b4mrl
