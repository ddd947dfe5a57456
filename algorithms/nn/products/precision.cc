#include "algorithms/nn/products/precision.h"

namespace b4mrl {

std::string_view PrecisionName(Precision precision) {
  return precision == Precision::kBf16 ? "bf16" : "fp32";
}

std::optional<Precision> FindPrecision(std::string_view name) {
  for (const Precision precision : {Precision::kFp32, Precision::kBf16}) {
    if (name == PrecisionName(precision)) return precision;
  }
  return std::nullopt;
}

bool HasBf16() {
  return __builtin_cpu_supports("avx512bf16") && __builtin_cpu_supports("avx512bw") &&
         __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq");
}

Status CheckPrecision(Precision precision) {
  if (precision == Precision::kFp32 || HasBf16()) return {};
  return Status(StatusCode::kFailedPrecondition,
                "precision bf16: this processor has no AVX512-BF16, with which AMD's processors "
                "since Zen 4 and Intel's Cooper Lake and Sapphire Rapids multiply bf16 numbers; "
                "use fp32");
}

}  // namespace b4mrl
