#include "algorithms/nn/products/blas.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <string_view>

#include "proto/base/rng.h"

namespace b4mrl {
namespace {

constexpr int kPadding = 3;  // rows of a larger matrix below each view
constexpr float kUntouched = 4.5f;

struct Shape {
  int rows, columns, inner;
};

struct PaddedMatrix {
  PaddedMatrix(int rows, int columns, std::string_view purpose)
      : buffer(rows + kPadding, columns), view(buffer.view().RowBlock(0, rows)) {
    Rng rng(5, purpose);
    rng.FillNormal(buffer.values());
  }

  MatrixBuffer<float> buffer;
  MatrixView<float> view;
};

float At(MatrixView<const float> matrix, Transpose transpose, int row, int column) {
  return transpose == Transpose::kYes ? matrix(column, row) : matrix(row, column);
}

void Fill(PaddedMatrix& matrix, float inside) {
  for (float& number : matrix.buffer.values()) number = kUntouched;
  for (int i = 0; i < matrix.view.columns; ++i) {
    std::fill(matrix.view.column(i), matrix.view.column(i) + matrix.view.rows, inside);
  }
}

// Whether c is op(a) op(b), and what lies between its columns is what it was.
void CheckProduct(const PaddedMatrix& a, Transpose transpose_a, const PaddedMatrix& b,
                  Transpose transpose_b, const PaddedMatrix& c, int inner) {
  for (int i = 0; i < c.view.columns; ++i) {
    for (int k = 0; k < c.view.rows; ++k) {
      double sum = 0;
      double magnitude = 0;
      for (int j = 0; j < inner; ++j) {
        const double term = double{At(a.view, transpose_a, k, j)} * At(b.view, transpose_b, j, i);
        sum += term;
        magnitude += std::abs(term);
      }
      // Every addition may round by half a unit in the last place of a partial sum.
      const double tolerance = (inner + 1) * std::numeric_limits<float>::epsilon() * magnitude;
      REQUIRE(std::abs(c.view(k, i) - sum) <= tolerance);
    }
    for (int k = c.view.rows; k < c.view.stride; ++k) REQUIRE(c.view(k, i) == kUntouched);
  }
}

TEST_CASE("a product equals its definition for every shape, transposition and stride") {
  // Layers of a learner, single rows and columns, and a product that is cut into columns.
  const Shape shape = GENERATE(Shape{20, 13, 7}, Shape{1, 9, 8}, Shape{9, 1, 8}, Shape{1, 1, 5},
                               Shape{64, 300, 23}, Shape{128, 96, 128});
  const Transpose transpose_a = GENERATE(Transpose::kNo, Transpose::kYes);
  const Transpose transpose_b = GENERATE(Transpose::kNo, Transpose::kYes);
  const auto [rows, columns, inner] = shape;
  const bool a_flipped = transpose_a == Transpose::kYes;
  const bool b_flipped = transpose_b == Transpose::kYes;
  const PaddedMatrix a(a_flipped ? inner : rows, a_flipped ? rows : inner, "a");
  const PaddedMatrix b(b_flipped ? columns : inner, b_flipped ? inner : columns, "b");
  PaddedMatrix c(rows, columns, "c");
  CAPTURE(rows, columns, inner, a_flipped, b_flipped);

  // Not a number may not survive in a destination that is overwritten.
  Fill(c, std::numeric_limits<float>::quiet_NaN());
  Multiply<float>(a.view, transpose_a, b.view, transpose_b, c.view);
  CheckProduct(a, transpose_a, b, transpose_b, c, inner);
}

}  // namespace
}  // namespace b4mrl
