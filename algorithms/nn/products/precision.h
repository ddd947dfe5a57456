// The precision of matrix products in training.
//
// bf16 rounds the factors of a product to 8 significant bits and sums in fp32; processors with
// AVX512-BF16 (AMD since Zen 4, Intel Cooper Lake and Sapphire Rapids) then multiply twice as many
// numbers a cycle. Networks use it for the products of layers between two hidden layers. The
// weights of all networks, targets included, optimisers, first layers and output layers stay in
// fp32. Thread rule: pure functions.
#pragma once

#include <optional>
#include <string_view>

#include "proto/base/status.h"

namespace b4mrl {

enum class Precision { kFp32, kBf16 };

// "fp32" or "bf16".
std::string_view PrecisionName(Precision precision);
// The precision of that name, if there is one.
std::optional<Precision> FindPrecision(std::string_view name);
// Whether this processor and its operating system can multiply bf16 numbers.
bool HasBf16();
// kFailedPrecondition for kBf16 where HasBf16() is false.
Status CheckPrecision(Precision precision);

}  // namespace b4mrl
