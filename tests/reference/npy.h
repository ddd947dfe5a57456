// Reads the little part of NumPy's npy format that the reference files use: float64, little-endian,
// C order.
#pragma once

#include <catch2/catch.hpp>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <span>
#include <string>
#include <vector>

namespace b4mrl {

struct NpyArray {
  std::vector<size_t> shape;
  std::vector<double> values;

  // Row j of matrix i of an array of three axes.
  std::span<const double> Row(size_t i, size_t j) const {
    return std::span(values).subspan((i * shape[1] + j) * shape[2], shape[2]);
  }
};

inline NpyArray ReadNpy(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  const std::string bytes(std::istreambuf_iterator<char>(file), {});
  REQUIRE(bytes.size() > 10);
  REQUIRE(bytes.substr(1, 5) == "NUMPY");
  uint16_t header_size = 0;
  std::memcpy(&header_size, bytes.data() + 8, sizeof(header_size));
  const std::string header = bytes.substr(10, header_size);
  REQUIRE(header.find("'<f8'") != std::string::npos);
  REQUIRE(header.find("'fortran_order': False") != std::string::npos);

  NpyArray array;
  size_t count = 1;
  const char* cursor = header.c_str() + header.find('(') + 1;
  for (char* end = nullptr; *cursor != ')'; cursor = *end == ',' ? end + 1 : end) {
    array.shape.push_back(std::strtoull(cursor, &end, 10));
    REQUIRE(end != cursor);
    count *= array.shape.back();
  }
  array.values.resize(count);
  REQUIRE(bytes.size() == 10 + header_size + count * sizeof(double));
  std::memcpy(array.values.data(), bytes.data() + 10 + header_size, count * sizeof(double));
  return array;
}

}  // namespace b4mrl
