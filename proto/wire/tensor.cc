#include "proto/wire/tensor.h"

#include <algorithm>
#include <array>
#include <string_view>

#include "proto/base/finite.h"

namespace b4mrl {

namespace {

struct ElementType {
  std::string_view name;
  size_t bytes;
};

// By the types' numbers.
constexpr std::array<ElementType, 8> kElementTypes = {{
    {"unspecified", 0},
    {"float32", 4},
    {"float64", 8},
    {"int32", 4},
    {"int64", 8},
    {"uint8", 1},
    {"uint32", 4},
    {"uint64", 8},
}};
static_assert(kElementTypes.size() == static_cast<size_t>(DType::kUint64) + 1);

const ElementType& TypeOf(DType dtype) {
  static constexpr ElementType kUnknown = {"unknown", 0};
  const auto number = static_cast<size_t>(dtype);
  return number < kElementTypes.size() ? kElementTypes[number] : kUnknown;
}

}  // namespace

size_t DTypeSize(DType dtype) { return TypeOf(dtype).bytes; }
std::string DTypeName(DType dtype) { return std::string(TypeOf(dtype).name); }

uint64_t TensorView::elements() const {
  uint64_t count = 1;
  for (const uint64_t extent : shape) count *= extent;
  return count;
}

void CopyToDoubles(const TensorView& tensor, size_t first, std::span<double> out) {
  if (tensor.dtype == DType::kFloat64) {
    std::memcpy(out.data(), tensor.As<double>().data() + first, out.size_bytes());
    return;
  }
  const std::span<const float> values = tensor.As<float>().subspan(first, out.size());
  std::copy(values.begin(), values.end(), out.begin());
}

bool AllFinite(const TensorView& tensor) {
  if (tensor.dtype == DType::kFloat64) return AllFinite(tensor.As<double>());
  if (tensor.dtype == DType::kFloat32) return AllFinite(tensor.As<float>());
  return true;
}

}  // namespace b4mrl
