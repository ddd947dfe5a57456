#include "algorithms/nn/products/kernel_choice.h"

#include <catch2/catch.hpp>

namespace b4mrl {
namespace {

constexpr VectorInstructions kNone = {};
constexpr VectorInstructions kAvx2 = {.avx2_fma = true};
constexpr VectorInstructions kAvx512 = {.avx2_fma = true, .avx512 = true};
constexpr VectorInstructions kBf16 = {.avx2_fma = true, .avx512 = true, .avx512_bf16 = true};

TEST_CASE("Kernels that OpenBLAS fell back to give way to the best that the processor can run") {
  CHECK(BetterBlasKernels("Prescott", kBf16) == "Cooperlake");
  CHECK(BetterBlasKernels("Prescott", kAvx512) == "SkylakeX");
  CHECK(BetterBlasKernels("Prescott", kAvx2) == "Haswell");
  CHECK(BetterBlasKernels("Prescott", kNone) == "");
}

TEST_CASE("Kernels that OpenBLAS chose stay") {
  for (const char* chosen : {"Haswell", "Zen", "SkylakeX", "Cooperlake", "SapphireRapids"}) {
    CHECK(BetterBlasKernels(chosen, kBf16) == "");
  }
}

}  // namespace
}  // namespace b4mrl
