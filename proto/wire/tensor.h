// Element types and views of the arrays that travel in frame 2. Views own nothing; they live as
// long as the message they were read from. No thread rule beyond that.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <span>
#include <string>

#include "proto/base/limits.h"

namespace b4mrl {

// Element types; their numbers equal those of pb::DType.
enum class DType : uint8_t {
  kUnspecified = 0,
  kFloat32 = 1,
  kFloat64 = 2,
  kInt32 = 3,
  kInt64 = 4,
  kUint8 = 5,
  kUint32 = 6,
  kUint64 = 7,
};

// Bytes of one element; 0 for an unknown type.
size_t DTypeSize(DType dtype);
std::string DTypeName(DType dtype);

template <typename T>
constexpr DType DTypeOf() {
  if constexpr (std::is_same_v<T, float>) return DType::kFloat32;
  if constexpr (std::is_same_v<T, double>) return DType::kFloat64;
  if constexpr (std::is_same_v<T, int32_t>) return DType::kInt32;
  if constexpr (std::is_same_v<T, int64_t>) return DType::kInt64;
  if constexpr (std::is_same_v<T, uint8_t>) return DType::kUint8;
  if constexpr (std::is_same_v<T, uint32_t>) return DType::kUint32;
  if constexpr (std::is_same_v<T, uint64_t>) return DType::kUint64;
  return DType::kUnspecified;
}

// The extents of an array, outermost first; at most limits::kMaxArrayDimensions. Stored without
// heap memory, since every message has several shapes.
class Shape {
 public:
  Shape() = default;
  // Drops extents beyond limits::kMaxArrayDimensions; messages with more are refused before.
  template <typename Iterator>
  Shape(Iterator begin, Iterator end) {
    while (begin != end && size_ < extents_.size()) extents_[size_++] = *begin++;
  }
  Shape(std::initializer_list<uint64_t> extents) : Shape(extents.begin(), extents.end()) {}

  size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  uint64_t operator[](size_t axis) const { return extents_[axis]; }
  const uint64_t* begin() const { return extents_.data(); }
  const uint64_t* end() const { return extents_.data() + size_; }

 private:
  std::array<uint64_t, limits::kMaxArrayDimensions> extents_{};
  size_t size_ = 0;
};

// A validated row-major array: `data` is aligned for its element type and spans the whole shape.
struct TensorView {
  DType dtype = DType::kUnspecified;
  Shape shape;
  const std::byte* data = nullptr;

  uint64_t elements() const;
  size_t bytes() const { return elements() * DTypeSize(dtype); }
  // Length of the first axis; 1 for a scalar.
  uint64_t rows() const { return shape.empty() ? 1 : shape[0]; }
  // The elements as T; T must be the element type.
  template <typename T>
  std::span<const T> As() const {
    return {reinterpret_cast<const T*>(data), static_cast<size_t>(elements())};
  }
};

// Copies float32 or float64 elements [first, first + out.size()) into doubles.
void CopyToDoubles(const TensorView& tensor, size_t first, std::span<double> out);
// True when every element of a floating-point tensor is finite.
bool AllFinite(const TensorView& tensor);

}  // namespace b4mrl
