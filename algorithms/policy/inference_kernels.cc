#include "algorithms/policy/inference_kernels.h"

#include <immintrin.h>

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>

namespace b4mrl::inference {
namespace {

constexpr int kLanes = 8;
static_assert(kPanel == 2 * kLanes);

// Calls body(0), ..., body(kCount - 1) with constant arguments: GCC keeps an array that is indexed
// by constants in registers, but not an array that is indexed by a loop variable.
template <int kCount, typename Body>
inline void Unrolled(Body body) {
  [&]<int... kIndex>(std::integer_sequence<int, kIndex...>) {
    (body(std::integral_constant<int, kIndex>()), ...);
  }
  (std::make_integer_sequence<int, kCount>());
}

// Computes one panel of outputs for kRows rows; 2 kRows accumulators stay in registers over all
// inputs. Rows only share loads; no output's arithmetic depends on kRows.
template <int kRows>
inline void DensePanel(const float* weights, const float* bias, int inputs, bool relu,
                       const float* input, std::ptrdiff_t input_stride, float* output,
                       std::ptrdiff_t output_stride) {
  __m256 low[kRows], high[kRows];
  Unrolled<kRows>([&](auto row) {
    low[row] = _mm256_loadu_ps(bias);
    high[row] = _mm256_loadu_ps(bias + kLanes);
  });
  for (int k = 0; k < inputs; ++k) {
    const __m256 weight_low = _mm256_loadu_ps(weights);
    const __m256 weight_high = _mm256_loadu_ps(weights + kLanes);
    weights += kPanel;
    Unrolled<kRows>([&](auto row) {
      const __m256 x = _mm256_broadcast_ss(input + row * input_stride + k);
      low[row] = _mm256_fmadd_ps(weight_low, x, low[row]);
      high[row] = _mm256_fmadd_ps(weight_high, x, high[row]);
    });
  }
  const __m256 zero = _mm256_setzero_ps();
  Unrolled<kRows>([&](auto row) {
    float* out = output + row * output_stride;
    // max(0, NaN) is NaN in this operand order.
    _mm256_storeu_ps(out, relu ? _mm256_max_ps(zero, low[row]) : low[row]);
    _mm256_storeu_ps(out + kLanes, relu ? _mm256_max_ps(zero, high[row]) : high[row]);
  });
}

// exp(x) for x clamped to [-87, 88]: 2^n exp(r), |r| <= log(2)/2, with log 2 split in two so that r
// is nearly exact, and a Taylor polynomial of degree 7 (truncation below 1e-8 relative).
inline __m256 Exp(__m256 x) {
  x = _mm256_min_ps(_mm256_set1_ps(88.0f), x);
  x = _mm256_max_ps(_mm256_set1_ps(-87.0f), x);
  const __m256 n = _mm256_round_ps(_mm256_mul_ps(x, _mm256_set1_ps(1.44269504f)),
                                   _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC);
  __m256 r = _mm256_fnmadd_ps(n, _mm256_set1_ps(0.693359375f), x);
  r = _mm256_fnmadd_ps(n, _mm256_set1_ps(-2.12194440e-4f), r);
  __m256 p = _mm256_set1_ps(1.0f / 5040);
  p = _mm256_fmadd_ps(p, r, _mm256_set1_ps(1.0f / 720));
  p = _mm256_fmadd_ps(p, r, _mm256_set1_ps(1.0f / 120));
  p = _mm256_fmadd_ps(p, r, _mm256_set1_ps(1.0f / 24));
  p = _mm256_fmadd_ps(p, r, _mm256_set1_ps(1.0f / 6));
  p = _mm256_fmadd_ps(p, r, _mm256_set1_ps(0.5f));
  p = _mm256_fmadd_ps(p, r, _mm256_set1_ps(1.0f));
  p = _mm256_fmadd_ps(p, r, _mm256_set1_ps(1.0f));
  // n is in [-126, 127]: adding it to the exponent of 1.0f gives 2^n.
  const __m256i exponent =
      _mm256_slli_epi32(_mm256_add_epi32(_mm256_cvtps_epi32(n), _mm256_set1_epi32(127)), 23);
  return _mm256_mul_ps(p, _mm256_castsi256_ps(exponent));
}

// log(x) for positive normal x: exponent * log 2 + 2 atanh((m - 1) / (m + 1)) with the mantissa m
// in [1/sqrt 2, sqrt 2), the series to the ninth power (truncation below 1e-8).
inline __m256 Log(__m256 x) {
  const __m256 one = _mm256_set1_ps(1.0f);
  // After subtracting the bits of 1/sqrt 2, the exponent field counts powers of 2 from 1/sqrt 2.
  const __m256i bits = _mm256_castps_si256(x);
  const __m256i offset = _mm256_sub_epi32(bits, _mm256_set1_epi32(0x3f3504f3));
  const __m256i exponent = _mm256_srai_epi32(offset, 23);
  const __m256 m = _mm256_castsi256_ps(_mm256_sub_epi32(bits, _mm256_slli_epi32(exponent, 23)));
  const __m256 t = _mm256_div_ps(_mm256_sub_ps(m, one), _mm256_add_ps(m, one));
  const __m256 square = _mm256_mul_ps(t, t);
  __m256 p = _mm256_set1_ps(2.0f / 9);
  p = _mm256_fmadd_ps(p, square, _mm256_set1_ps(2.0f / 7));
  p = _mm256_fmadd_ps(p, square, _mm256_set1_ps(2.0f / 5));
  p = _mm256_fmadd_ps(p, square, _mm256_set1_ps(2.0f / 3));
  p = _mm256_fmadd_ps(p, square, _mm256_set1_ps(2.0f));
  return _mm256_fmadd_ps(_mm256_cvtepi32_ps(exponent), _mm256_set1_ps(0.693147181f),
                         _mm256_mul_ps(p, t));
}

// tanh(x) = sign(x) (1 - 2 / (exp(2|x|) + 1)). For |x| below 0.25, where this formula cancels, the
// odd Taylor series to x^9 (truncation below 1e-8 relative).
inline __m256 Tanh(__m256 x) {
  const __m256 sign_bit = _mm256_set1_ps(-0.0f);
  const __m256 sign = _mm256_and_ps(x, sign_bit);
  const __m256 magnitude = _mm256_andnot_ps(sign_bit, x);
  const __m256 one = _mm256_set1_ps(1.0f);
  const __m256 two = _mm256_set1_ps(2.0f);
  const __m256 power = Exp(_mm256_mul_ps(two, magnitude));
  const __m256 large =
      _mm256_or_ps(_mm256_sub_ps(one, _mm256_div_ps(two, _mm256_add_ps(power, one))), sign);
  const __m256 square = _mm256_mul_ps(x, x);
  __m256 p = _mm256_set1_ps(62.0f / 2835);
  p = _mm256_fmadd_ps(p, square, _mm256_set1_ps(-17.0f / 315));
  p = _mm256_fmadd_ps(p, square, _mm256_set1_ps(2.0f / 15));
  p = _mm256_fmadd_ps(p, square, _mm256_set1_ps(-1.0f / 3));
  const __m256 small = _mm256_fmadd_ps(_mm256_mul_ps(p, square), x, x);
  const __m256 is_small = _mm256_cmp_ps(magnitude, _mm256_set1_ps(0.25f), _CMP_LT_OQ);
  return _mm256_blendv_ps(large, small, is_small);
}

}  // namespace

void Dense(const float* weights, const float* bias, int inputs, int outputs, bool relu,
           const float* input, int input_stride, int rows, float* output, int output_stride) {
  // Six rows by two vectors: 12 accumulators, two vectors of weights and one broadcast input fit in
  // 16 registers.
  constexpr int kRows = 6;
  const std::ptrdiff_t in = input_stride;
  const std::ptrdiff_t out = output_stride;
  const int panels = Padded(outputs) / kPanel;
  for (int panel = 0; panel < panels; ++panel) {
    const float* w = weights + static_cast<std::ptrdiff_t>(panel) * kPanel * inputs;
    const float* b = bias + panel * kPanel;
    float* o = output + panel * kPanel;
    int row = 0;
    for (; row + kRows <= rows; row += kRows) {
      DensePanel<kRows>(w, b, inputs, relu, input + row * in, in, o + row * out, out);
    }
    for (; row + 2 <= rows; row += 2) {
      DensePanel<2>(w, b, inputs, relu, input + row * in, in, o + row * out, out);
    }
    if (row < rows) {
      DensePanel<1>(w, b, inputs, relu, input + row * in, in, o + row * out, out);
    }
  }
}

bool AllFinite(const float* values, std::size_t count) {
  // Without an early return, so that the loop is vectorised: almost every call sees finite numbers.
  uint32_t largest = 0;
  for (std::size_t i = 0; i < count; ++i) {
    largest = std::max(largest, std::bit_cast<uint32_t>(values[i]) & 0x7fffffffu);
  }
  return largest < 0x7f800000u;  // the bits of infinity; those of NaN are above
}

void TanhInPlace(int count, float* values) {
  for (int i = 0; i < Padded(count); i += kLanes) {
    _mm256_storeu_ps(values + i, Tanh(_mm256_loadu_ps(values + i)));
  }
}

void SquashSample(int count, float low, float high, const float* log_std, const float* noise,
                  float* mean, float* terms) {
  for (int i = 0; i < Padded(count); i += kLanes) {
    __m256 s = _mm256_loadu_ps(log_std + i);
    s = _mm256_min_ps(_mm256_set1_ps(high), s);
    s = _mm256_max_ps(_mm256_set1_ps(low), s);
    const __m256 e = _mm256_loadu_ps(noise + i);
    const __m256 a = Tanh(_mm256_fmadd_ps(Exp(s), e, _mm256_loadu_ps(mean + i)));
    const __m256 slope = _mm256_fnmadd_ps(a, a, _mm256_set1_ps(1.0f + 1e-6f));
    // -e^2/2 - log(2 pi)/2, from which log_std and log(1 - a^2 + 1e-6) are then subtracted.
    const __m256 gaussian =
        _mm256_fmadd_ps(_mm256_mul_ps(e, _mm256_set1_ps(-0.5f)), e, _mm256_set1_ps(-0.918938533f));
    _mm256_storeu_ps(mean + i, a);
    _mm256_storeu_ps(terms + i, _mm256_sub_ps(_mm256_sub_ps(gaussian, s), Log(slope)));
  }
}

}  // namespace b4mrl::inference
