#include "proto/wire/tensor.h"

#include <algorithm>

#include "proto/base/finite.h"

namespace b4mrl {

size_t DTypeSize(DType dtype) {
  switch (dtype) {
    case DType::kUnspecified:
      return 0;
    case DType::kUint8:
      return 1;
    case DType::kFloat32:
    case DType::kInt32:
    case DType::kUint32:
      return 4;
    case DType::kFloat64:
    case DType::kInt64:
    case DType::kUint64:
      return 8;
  }
  return 0;
}

std::string DTypeName(DType dtype) {
  switch (dtype) {
    case DType::kUnspecified:
      return "unspecified";
    case DType::kFloat32:
      return "float32";
    case DType::kFloat64:
      return "float64";
    case DType::kInt32:
      return "int32";
    case DType::kInt64:
      return "int64";
    case DType::kUint8:
      return "uint8";
    case DType::kUint32:
      return "uint32";
    case DType::kUint64:
      return "uint64";
  }
  return "unknown";
}

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
