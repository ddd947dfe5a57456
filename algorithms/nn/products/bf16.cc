#include "algorithms/nn/products/bf16.h"

#include <immintrin.h>

// algorithms/CMakeLists.txt compiles this file for AVX-512 with bf16, whatever processor the build
// aims at. Nothing of the standard library is instantiated here: the linker could choose this
// file's copy for the whole program, which then would not run on older processors.

namespace b4mrl::bf16 {
namespace {

constexpr int kLanes = 16;  // pairs in a register
// A tile of c that one loop computes: up to 4 registers of rows by 6 columns, so that its 24 sums,
// 4 registers of `a` and one of `b` fit the 32 registers, and 24 independent sums hide the latency.
constexpr int kTileRegisters = 4;
constexpr int kTileColumns = 6;

int Registers(int numbers) { return (numbers + kLanes - 1) / kLanes; }

// Pairs from one row of packed lanes to the next: an odd number of registers, so that the rows of a
// panel spread over all sets of the first-level cache.
int64_t LaneStride(int outer) { return static_cast<int64_t>(Registers(outer) | 1) * kLanes; }

// Pairs from one packed column to the next.
int64_t ColumnStride(int inner) { return Registers((inner + 1) / 2) * kLanes; }

// The first min(count, 16) lanes.
__mmask16 LaneMask(int count) {
  return count >= kLanes ? 0xffff : static_cast<__mmask16>((1u << count) - 1);
}

// Rounds 16 numbers of two columns to bf16 and pairs them, lane by lane.
__m512i PairUp(__m512 first, __m512 second) {
  // Halves of the conversion's result: 16 numbers of `first` below 16 numbers of `second`.
  const __m512i interleave =
      _mm512_set_epi16(31, 15, 30, 14, 29, 13, 28, 12, 27, 11, 26, 10, 25, 9, 24, 8, 23, 7, 22, 6,
                       21, 5, 20, 4, 19, 3, 18, 2, 17, 1, 16, 0);
  const __m512i halves = reinterpret_cast<__m512i>(_mm512_cvtne2ps_pbh(second, first));
  return _mm512_permutexvar_epi16(interleave, halves);
}

// The first min(count, 16) numbers, then 0; count may be 0 or less.
__m512 LoadNumbers(const float* numbers, int count) {
  if (count >= kLanes) return _mm512_loadu_ps(numbers);
  return count > 0 ? _mm512_maskz_loadu_ps(LaneMask(count), numbers) : _mm512_setzero_ps();
}

// Rounds rows [row, row + 32) of a column to 16 pairs; rows from `rows` on are 0.
__m512i ColumnAt(const float* column, int row, int rows) {
  const __m512 low = LoadNumbers(column + row, rows - row);
  const __m512 high = LoadNumbers(column + row + kLanes, rows - row - kLanes);
  return reinterpret_cast<__m512i>(_mm512_cvtne2ps_pbh(high, low));
}

// Transposes a square of 16 x 16 pairs.
void Transpose(__m512i (&square)[kLanes]) {
  __m512i step[kLanes];
  for (int i = 0; i < kLanes; i += 2) {
    step[i] = _mm512_unpacklo_epi32(square[i], square[i + 1]);
    step[i + 1] = _mm512_unpackhi_epi32(square[i], square[i + 1]);
  }
  for (int i = 0; i < kLanes; i += 4) {
    for (int j = 0; j < 2; ++j) {
      square[i + 2 * j] = _mm512_unpacklo_epi64(step[i + j], step[i + j + 2]);
      square[i + 2 * j + 1] = _mm512_unpackhi_epi64(step[i + j], step[i + j + 2]);
    }
  }
  // Now square[4 g + j] holds columns j, 4 + j, 8 + j, 12 + j of rows 4 g to 4 g + 3.
  for (int j = 0; j < 4; ++j) {
    const __m512i low = _mm512_shuffle_i32x4(square[j], square[4 + j], 0x88);
    const __m512i high = _mm512_shuffle_i32x4(square[j], square[4 + j], 0xdd);
    const __m512i low2 = _mm512_shuffle_i32x4(square[8 + j], square[12 + j], 0x88);
    const __m512i high2 = _mm512_shuffle_i32x4(square[8 + j], square[12 + j], 0xdd);
    step[j] = _mm512_shuffle_i32x4(low, low2, 0x88);
    step[8 + j] = _mm512_shuffle_i32x4(low, low2, 0xdd);
    step[4 + j] = _mm512_shuffle_i32x4(high, high2, 0x88);
    step[12 + j] = _mm512_shuffle_i32x4(high, high2, 0xdd);
  }
  for (int i = 0; i < kLanes; ++i) square[i] = step[i];
}

// One tile of c: kRegisters registers of rows by kColumns columns. `last`: lanes of the last
// register that are rows of c.
template <int kRegisters, int kColumns>
inline __attribute__((always_inline)) void MultiplyTile(const Pairs& a, const Pairs& b,
                                                        __mmask16 last, float* c, int c_stride) {
  __m512 sums[kColumns][kRegisters];
#pragma GCC unroll 6
  for (int j = 0; j < kColumns; ++j) {
#pragma GCC unroll 4
    for (int r = 0; r < kRegisters; ++r) sums[j][r] = _mm512_setzero_ps();
  }
  const Pair* lanes = a.data;
  const Pair* numbers = b.data;
  for (int k = 0; k < a.inner; ++k) {
    __m512bh rows[kRegisters];
#pragma GCC unroll 4
    for (int r = 0; r < kRegisters; ++r) {
      rows[r] = reinterpret_cast<__m512bh>(_mm512_loadu_si512(lanes + r * kLanes));
    }
#pragma GCC unroll 6
    for (int j = 0; j < kColumns; ++j) {
      const __m512i number = _mm512_set1_epi32(static_cast<int>(numbers[j * b.outer_stride]));
#pragma GCC unroll 4
      for (int r = 0; r < kRegisters; ++r) {
        sums[j][r] = _mm512_dpbf16_ps(sums[j][r], rows[r], reinterpret_cast<__m512bh>(number));
      }
    }
    lanes += a.inner_stride;
    numbers += b.inner_stride;
  }
#pragma GCC unroll 6
  for (int j = 0; j < kColumns; ++j) {
    float* column = c + static_cast<int64_t>(j) * c_stride;
#pragma GCC unroll 4
    for (int r = 0; r + 1 < kRegisters; ++r) _mm512_storeu_ps(column + r * kLanes, sums[j][r]);
    _mm512_mask_storeu_ps(column + (kRegisters - 1) * kLanes, last, sums[j][kRegisters - 1]);
  }
}

// Calls body.operator()<n>() with n = min(count, kMost), for count >= 1.
template <int kMost, typename Body>
inline __attribute__((always_inline)) void WithCount(int count, const Body& body) {
  if constexpr (kMost > 1) {
    if (count < kMost) return WithCount<kMost - 1>(count, body);
  }
  body.template operator()<kMost>();
}

// A panel of kRegisters registers of rows of c, all its columns.
template <int kRegisters>
void MultiplyPanel(const Pairs& a, Pairs b, __mmask16 last, MatrixView<float> c) {
  for (int column = 0; column < c.columns; column += kTileColumns) {
    WithCount<kTileColumns>(c.columns - column, [&]<int kColumns>() {
      MultiplyTile<kRegisters, kColumns>(a, b, last, c.data, c.stride);
    });
    b.data += kTileColumns * b.outer_stride;
    c.data += static_cast<int64_t>(kTileColumns) * c.stride;
  }
}

}  // namespace

int64_t PackedSize(int outer, int inner) {
  const int64_t lanes = LaneStride(outer) * ((inner + 1) / 2);
  const int64_t columns = ColumnStride(inner) * outer;
  return lanes > columns ? lanes : columns;
}

Pairs PackColumnPairs(MatrixView<const float> matrix, Pair* packed) {
  const int64_t stride = LaneStride(matrix.rows);
  const int pairs = (matrix.columns + 1) / 2;
  for (int k = 0; k < pairs; ++k) {
    const float* first = matrix.data + static_cast<int64_t>(2 * k) * matrix.stride;
    const bool has_second = 2 * k + 1 < matrix.columns;
    Pair* out = packed + k * stride;
    for (int row = 0; row < matrix.rows; row += kLanes) {
      const __mmask16 mask = LaneMask(matrix.rows - row);
      const __m512 low = _mm512_maskz_loadu_ps(mask, first + row);
      const __m512 high = has_second ? _mm512_maskz_loadu_ps(mask, first + matrix.stride + row)
                                     : _mm512_setzero_ps();
      _mm512_storeu_si512(out + row, PairUp(low, high));
    }
  }
  return {packed, pairs, stride, 1};
}

Pairs PackColumns(MatrixView<const float> matrix, Pair* packed) {
  const int64_t stride = ColumnStride(matrix.rows);
  for (int column = 0; column < matrix.columns; ++column) {
    const float* numbers = matrix.data + static_cast<int64_t>(column) * matrix.stride;
    for (int row = 0; row < matrix.rows; row += 2 * kLanes) {
      _mm512_storeu_si512(packed + column * stride + row / 2, ColumnAt(numbers, row, matrix.rows));
    }
  }
  return {packed, (matrix.rows + 1) / 2, 1, stride};
}

Pairs PackRowPairs(MatrixView<const float> matrix, Pair* packed) {
  const int64_t stride = LaneStride(matrix.columns);
  const int pairs = (matrix.rows + 1) / 2;
  for (int column = 0; column < matrix.columns; column += kLanes) {
    for (int k = 0; k < pairs; k += kLanes) {
      __m512i square[kLanes];
      for (int j = 0; j < kLanes; ++j) {
        const float* numbers = matrix.data + static_cast<int64_t>(column + j) * matrix.stride;
        square[j] = column + j < matrix.columns ? ColumnAt(numbers, 2 * k, matrix.rows)
                                                : _mm512_setzero_si512();
      }
      Transpose(square);
      for (int j = 0; j < kLanes && k + j < pairs; ++j) {
        _mm512_storeu_si512(packed + (k + j) * stride + column, square[j]);
      }
    }
  }
  return {packed, pairs, stride, 1};
}

void Multiply(const Pairs& a, const Pairs& b, MatrixView<float> c) {
  Pairs panel = a;
  for (int left = Registers(c.rows); left > 0;) {
    // Panels of nearly equal heights, since a flat one has too few sums to hide the latency.
    const int panels = (left + kTileRegisters - 1) / kTileRegisters;
    const int registers = (left + panels - 1) / panels;
    const __mmask16 last = LaneMask(c.rows - (registers - 1) * kLanes);
    WithCount<kTileRegisters>(
        registers, [&]<int kRegisters>() { MultiplyPanel<kRegisters>(panel, b, last, c); });
    panel.data += registers * kLanes;
    c.data += registers * kLanes;
    c.rows -= registers * kLanes;
    left -= registers;
  }
}

}  // namespace b4mrl::bf16
