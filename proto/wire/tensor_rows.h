// Rows of the arrays in replies of sessions and datasets.
#pragma once

#include <cstddef>
#include <span>

#include "proto/wire/tensor.h"

namespace b4mrl {

// Row `index` of a float32 array of shape (rows, width, ...).
inline std::span<const float> RowOf(const TensorView& tensor, size_t index) {
  const std::span<const float> values = tensor.As<float>();
  const size_t width = values.size() / static_cast<size_t>(tensor.rows());
  return values.subspan(index * width, width);
}

}  // namespace b4mrl
