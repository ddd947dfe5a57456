#include "algorithms/nn/products/bf16.h"

#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <limits>
#include <string_view>

#include "algorithms/nn/products/blas.h"
#include "algorithms/nn/products/precision.h"
#include "proto/base/rng.h"

namespace b4mrl {
namespace {

// `size` elements whose last one is the last before a page that cannot be accessed.
template <typename T>
class Guarded {
 public:
  explicit Guarded(int64_t size)
      : page_(sysconf(_SC_PAGESIZE)), bytes_(RoundUp(size * int64_t{sizeof(T)})) {
    void* mapped =
        mmap(nullptr, bytes_ + page_, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    REQUIRE(mapped != MAP_FAILED);
    start_ = static_cast<char*>(mapped);
    REQUIRE(mprotect(start_ + bytes_, page_, PROT_NONE) == 0);
    data_ = reinterpret_cast<T*>(start_ + bytes_) - size;
  }
  ~Guarded() { munmap(start_, bytes_ + page_); }
  Guarded(const Guarded&) = delete;
  Guarded& operator=(const Guarded&) = delete;

  T* data() { return data_; }

 private:
  int64_t RoundUp(int64_t bytes) const { return (bytes + page_ - 1) / page_ * page_; }

  int64_t page_, bytes_;
  char* start_;
  T* data_;
};

// A matrix of normals between whose columns lie numbers that no product may read: NaN.
struct Factor {
  Factor(int rows, int columns, std::string_view purpose)
      : stride(rows + 1),
        numbers(int64_t{stride} * (columns - 1) + rows),
        view(numbers.data(), rows, columns, stride) {
    Rng rng(7, purpose);
    std::fill_n(numbers.data(), int64_t{stride} * (columns - 1) + rows,
                std::numeric_limits<float>::quiet_NaN());
    for (int i = 0; i < columns; ++i) rng.FillNormal({view.column(i), static_cast<size_t>(rows)});
  }

  int stride;
  Guarded<float> numbers;
  MatrixView<float> view;
};

struct Product {
  Product(int rows, int columns, int inner_size, bool flip_a, bool flip_b)
      : inner(inner_size),
        a_flipped(flip_a),
        b_flipped(flip_b),
        a(flip_a ? inner : rows, flip_a ? rows : inner, "a"),
        b(flip_b ? columns : inner, flip_b ? inner : columns, "b"),
        c(rows, columns, "c"),
        packed_a(bf16::PackedSize(rows, inner)),
        packed_b(bf16::PackedSize(columns, inner)) {}

  void Compute() {
    const bf16::Pairs left = a_flipped ? bf16::PackRowPairs(a.view, packed_a.data())
                                       : bf16::PackColumnPairs(a.view, packed_a.data());
    const bf16::Pairs right = b_flipped ? bf16::PackColumnPairs(b.view, packed_b.data())
                                        : bf16::PackColumns(b.view, packed_b.data());
    bf16::Multiply(left, right, c.view);
  }
  float A(int row, int k) const { return a_flipped ? a.view(k, row) : a.view(row, k); }
  float B(int k, int column) const { return b_flipped ? b.view(column, k) : b.view(k, column); }

  int inner;
  bool a_flipped, b_flipped;
  Factor a, b, c;
  Guarded<bf16::Pair> packed_a, packed_b;
};

// `number` rounded to bf16: to nearest, ties to even.
double Rounded(float number) {
  uint32_t bits;
  std::memcpy(&bits, &number, sizeof(bits));
  bits += 0x7fff + (bits >> 16 & 1);
  bits &= 0xffff0000;
  std::memcpy(&number, &bits, sizeof(bits));
  return number;
}

// Compares with sums in float64, of the rounded and of the given numbers.
void CheckProduct(const Product& product) {
  double error = 0, magnitude = 0;
  for (int j = 0; j < product.c.view.columns; ++j) {
    for (int i = 0; i < product.c.view.rows; ++i) {
      double rounded = 0, exact = 0, sum = 0;
      for (int k = 0; k < product.inner; ++k) {
        const float a = product.A(i, k), b = product.B(k, j);
        rounded += Rounded(a) * Rounded(b);
        exact += double{a} * b;
        sum += std::abs(double{a} * b);
      }
      // Each of the fp32 sums may round by half a unit in the last place of a partial sum.
      const double fp32 = product.inner * std::numeric_limits<float>::epsilon() * 1.02 * sum;
      REQUIRE(std::abs(product.c.view(i, j) - rounded) <= fp32);
      // Both factors of every term may be off by half a unit in the last of 8 bits: 2^-8 each.
      REQUIRE(std::abs(product.c.view(i, j) - exact) <= (std::pow(2, -7) + 1e-4) * sum);
      error += std::abs(product.c.view(i, j) - exact);
      magnitude += sum;
    }
    if (j + 1 == product.c.view.columns) continue;
    REQUIRE(std::isnan(product.c.view.column(j)[product.c.view.rows]));  // between two columns
  }
  // On average roundings cancel to well below the bound of a single term.
  CHECK(error <= std::pow(2, -8) * magnitude);
}

bool Unavailable() {
  if (HasBf16()) return false;
  WARN("skipped: this processor has no AVX512-BF16");
  return true;
}

}  // namespace

TEST_CASE("a bf16 product has the rounding of its factors and no other error, for widths 1 to 70") {
  if (Unavailable()) return;
  const bool a_flipped = GENERATE(false, true), b_flipped = GENERATE(false, true);
  for (int width = 1; width <= 70; ++width) {
    // Batches around the kernel's tiles of six columns, odd and even.
    for (const int batch : {1, 2, 5, 6, 7, 13, 31}) {
      CAPTURE(width, batch, a_flipped, b_flipped);
      Product layer(width, batch, 71 - width, a_flipped, b_flipped);
      layer.Compute();
      CheckProduct(layer);
      Product square(width, width, batch, a_flipped, b_flipped);  // as a weight's gradient
      square.Compute();
      CheckProduct(square);
    }
  }
}

TEST_CASE(
    "a bf16 product passes NaN and infinity through to what depends on them, and no further") {
  if (Unavailable()) return;
  const float special =
      GENERATE(std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity());
  const bool a_flipped = GENERATE(false, true), b_flipped = GENERATE(false, true);
  Product product(37, 9, 21, a_flipped, b_flipped);
  (a_flipped ? product.a.view(20, 36) : product.a.view(36, 20)) = special;
  product.Compute();
  for (int j = 0; j < 9; ++j) {
    for (int i = 0; i < 36; ++i) REQUIRE(std::isfinite(product.c.view(i, j)));
    REQUIRE_FALSE(std::isfinite(product.c.view(36, j)));
  }
  Product other(37, 9, 21, a_flipped, b_flipped);
  (b_flipped ? other.b.view(8, 20) : other.b.view(20, 8)) = special;
  other.Compute();
  for (int i = 0; i < 37; ++i) {
    for (int j = 0; j < 8; ++j) REQUIRE(std::isfinite(other.c.view(i, j)));
    REQUIRE_FALSE(std::isfinite(other.c.view(i, 8)));
  }
}

TEST_CASE("a bf16 product of a block of columns has the bits of the whole product's columns") {
  if (Unavailable()) return;
  Product whole(70, 31, 33, /*flip_a=*/true, /*flip_b=*/false);
  whole.Compute();
  Product part(70, 31, 33, /*flip_a=*/true, /*flip_b=*/false);
  const bf16::Pairs left = bf16::PackRowPairs(part.a.view, part.packed_a.data());
  for (int first = 0; first < 31; first += 4) {
    const int count = std::min(4, 31 - first);
    bf16::Multiply(left,
                   bf16::PackColumns(part.b.view.ColumnBlock(first, count), part.packed_b.data()),
                   part.c.view.ColumnBlock(first, count));
  }
  for (int j = 0; j < 31; ++j) {
    CHECK(std::equal(whole.c.view.column(j), whole.c.view.column(j) + 70, part.c.view.column(j)));
  }
}

TEST_CASE("precisions are found by their names") {
  CHECK(FindPrecision("fp32") == Precision::kFp32);
  CHECK(FindPrecision("bf16") == Precision::kBf16);
  CHECK_FALSE(FindPrecision("fp16").has_value());
  CHECK(CheckPrecision(Precision::kFp32).ok());
  CHECK(CheckPrecision(Precision::kBf16).ok() == HasBf16());
}

}  // namespace b4mrl
