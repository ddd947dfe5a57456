#include "proto/wire/tensor.h"

#include <array>
#include <catch2/catch.hpp>
#include <limits>

namespace b4mrl {
namespace {

template <typename T, size_t n>
TensorView ViewOf(const std::array<T, n>& values) {
  return {DTypeOf<T>(), {n}, reinterpret_cast<const std::byte*>(values.data())};
}

TEST_CASE("types have their sizes and names") {
  CHECK(DTypeSize(DType::kFloat32) == 4);
  CHECK(DTypeSize(DType::kFloat64) == 8);
  CHECK(DTypeSize(DType::kUint8) == 1);
  CHECK(DTypeSize(DType::kUnspecified) == 0);
  CHECK(DTypeSize(static_cast<DType>(99)) == 0);
  CHECK(DTypeName(DTypeOf<uint32_t>()) == "uint32");
}

TEST_CASE("part of a tensor is copied as doubles") {
  const std::array<float, 4> floats = {0.1f, 0.2f, 0.3f, 0.4f};
  const std::array<double, 4> doubles = {0.1, 0.2, 0.3, 0.4};
  std::array<double, 2> out{};
  CopyToDoubles(ViewOf(floats), 1, out);
  CHECK(out[1] == double{0.3f});
  CopyToDoubles(ViewOf(doubles), 2, out);
  CHECK(out[1] == 0.4);
}

TEST_CASE("one number that is not finite is found") {
  std::array<float, 3> floats = {1, 2, 3};
  std::array<double, 3> doubles = {1, 2, 3};
  CHECK(AllFinite(ViewOf(floats)));
  CHECK(AllFinite(ViewOf(doubles)));
  floats[2] = std::numeric_limits<float>::infinity();
  doubles[1] = std::numeric_limits<double>::quiet_NaN();
  CHECK_FALSE(AllFinite(ViewOf(floats)));
  CHECK_FALSE(AllFinite(ViewOf(doubles)));
}

TEST_CASE("a scalar has one element and one row") {
  TensorView scalar{DType::kFloat64, {}, nullptr};
  CHECK(scalar.elements() == 1);
  CHECK(scalar.rows() == 1);
  CHECK(scalar.bytes() == 8);
}

}  // namespace
}  // namespace b4mrl
