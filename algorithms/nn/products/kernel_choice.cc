#include "algorithms/nn/products/kernel_choice.h"

#include <unistd.h>

#include <cstdlib>
#include <string>

#include "algorithms/nn/products/blas.h"
#include "algorithms/nn/products/precision.h"
#include "proto/base/child_program.h"

namespace b4mrl {
namespace {

constexpr char kVariable[] = "OPENBLAS_CORETYPE";
constexpr std::string_view kFallback = "Prescott";

}  // namespace

VectorInstructions VectorInstructions::OfThisProcessor() {
  return {.avx2_fma = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"),
          .avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512cd") &&
                    __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512dq") &&
                    __builtin_cpu_supports("avx512vl"),
          .avx512_bf16 = HasBf16()};
}

std::string_view BetterBlasKernels(std::string_view chosen, const VectorInstructions& has) {
  if (chosen != kFallback) return "";
  if (has.avx512 && has.avx512_bf16) return "Cooperlake";
  if (has.avx512) return "SkylakeX";
  return has.avx2_fma ? "Haswell" : "";
}

void RestartWithBetterBlasKernels(char** argv) {
  if (std::getenv(kVariable) != nullptr) return;
  const std::string better(
      BetterBlasKernels(BlasKernelName(), VectorInstructions::OfThisProcessor()));
  if (better.empty()) return;
  setenv(kVariable, better.c_str(), 1);
  execv(ThisProgram().c_str(), argv);
  // It could not be started again: the slow kernels are right, too.
}

}  // namespace b4mrl
