#include "algorithms/nn/squashed_gaussian.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "algorithms/nn/products/eigen_map.h"
#include "algorithms/nn/products/strip.h"

namespace b4mrl {
namespace {

template <typename Scalar>
constexpr Scalar kHalfLogTwoPi = static_cast<Scalar>(0.91893853320467274178);

template <typename Scalar>
void SampleStrip(const SquashedGaussianOptions& options, MatrixView<const Scalar> head,
                 MatrixView<const Scalar> noise, MatrixView<Scalar> actions, Scalar* log_probs) {
  const int size = noise.rows;
  Strip<Scalar> mean, log_std, e, u, a, log_slope;
  Pack<Scalar>(head.RowBlock(0, size), mean);
  Pack<Scalar>(head.RowBlock(size, size), log_std);
  Pack<Scalar>(noise, e);
  log_std = log_std.max(static_cast<Scalar>(options.log_std_min))
                .min(static_cast<Scalar>(options.log_std_max));
  u = mean + log_std.exp() * e;
  a = u.tanh();
  if (options.form == LogProbForm::kEpsilon) {
    log_slope = (Scalar(1) - a * a + static_cast<Scalar>(options.epsilon)).log();
  } else {
    // log(1 - tanh(u)^2) = 2 (log 2 - |u| - log(1 + exp(-2|u|))): even in u, never overflows.
    log_slope =
        Scalar(2) * (std::numbers::ln2_v<Scalar> - u.abs() - (Scalar(-2) * u.abs()).exp().log1p());
  }
  log_slope = Scalar(-0.5) * e * e - log_std - log_slope - kHalfLogTwoPi<Scalar>;
  Unpack<Scalar>(a, actions);
  for (int i = 0; i < noise.columns; ++i) {
    Scalar sum = 0;
    for (int k = 0; k < size; ++k) sum += log_slope[i * size + k];
    log_probs[i] = sum;
  }
}

}  // namespace

template <typename Scalar>
void SampleSquashedGaussian(const SquashedGaussianOptions& options, MatrixView<const Scalar> head,
                            MatrixView<const Scalar> noise, MatrixView<Scalar> actions,
                            std::span<Scalar> log_probs) {
  const int columns_per_strip = ColumnsPerStrip(noise.rows);
  for (int first = 0; first < noise.columns; first += columns_per_strip) {
    const int count = std::min(columns_per_strip, noise.columns - first);
    SampleStrip<Scalar>(options, head.ColumnBlock(first, count), noise.ColumnBlock(first, count),
                        actions.ColumnBlock(first, count), log_probs.data() + first);
  }
}

template <typename Scalar>
void SquashedGaussianBackward(const SquashedGaussianOptions& options, MatrixView<const Scalar> head,
                              MatrixView<const Scalar> noise, MatrixView<const Scalar> actions,
                              MatrixView<const Scalar> action_gradient, Scalar log_prob_gradient,
                              MatrixView<Scalar> head_gradient) {
  const int size = noise.rows;
  const Scalar low = static_cast<Scalar>(options.log_std_min);
  const Scalar high = static_cast<Scalar>(options.log_std_max);
  const Scalar epsilon =
      options.form == LogProbForm::kEpsilon ? static_cast<Scalar>(options.epsilon) : Scalar(0);
  for (int i = 0; i < noise.columns; ++i) {
    for (int k = 0; k < size; ++k) {
      const Scalar a = actions(k, i);
      const Scalar slope = 1 - a * a;  // da/du
      // The exact form's ratio is 1, also in the limit where a rounds to +-1.
      const Scalar ratio = epsilon == 0 ? Scalar(1) : slope / (slope + epsilon);
      const Scalar to_u = action_gradient(k, i) * slope + log_prob_gradient * 2 * a * ratio;
      const Scalar raw = head(size + k, i);
      const bool clamped = raw < low || raw > high;
      head_gradient(k, i) = to_u;
      head_gradient(size + k, i) =
          clamped ? Scalar(0) : to_u * std::exp(raw) * noise(k, i) - log_prob_gradient;
    }
  }
}

template <typename Scalar>
void ScaleLogStd(MatrixView<const Scalar> head, std::span<const Scalar> scale,
                 MatrixView<Scalar> scaled) {
  const int size = head.rows / 2;
  for (int i = 0; i < head.columns; ++i) {
    const Scalar* __restrict raw = head.column(i);
    Scalar* __restrict out = scaled.column(i);
    for (int k = 0; k < size; ++k) out[k] = raw[k];
    for (int k = size; k < 2 * size; ++k) out[k] = scale[0] * raw[k] + scale[1];
  }
}

template <typename Scalar>
void ScaleLogStdBackward(MatrixView<const Scalar> head, std::span<const Scalar> scale,
                         MatrixView<Scalar> gradient, std::span<Scalar> scale_gradient) {
  const int size = head.rows / 2;
  double to_m = 0, to_b = 0;
  for (int i = 0; i < head.columns; ++i) {
    for (int k = size; k < 2 * size; ++k) {
      to_m += static_cast<double>(gradient(k, i)) * head(k, i);
      to_b += gradient(k, i);
      gradient(k, i) *= scale[0];
    }
  }
  scale_gradient[0] = static_cast<Scalar>(to_m);
  scale_gradient[1] = static_cast<Scalar>(to_b);
}

template <typename Scalar>
void TanhForward(MatrixView<const Scalar> head, MatrixView<Scalar> actions) {
  Strip<Scalar> strip;
  const int columns_per_strip = ColumnsPerStrip(head.rows);
  for (int first = 0; first < head.columns; first += columns_per_strip) {
    const int count = std::min(columns_per_strip, head.columns - first);
    Pack<Scalar>(head.ColumnBlock(first, count), strip);
    strip = strip.tanh();
    Unpack<Scalar>(strip, actions.ColumnBlock(first, count));
  }
}

template <typename Scalar>
void TanhBackward(MatrixView<const Scalar> actions, MatrixView<const Scalar> action_gradient,
                  MatrixView<Scalar> head_gradient) {
  ToEigen(head_gradient) =
      (ToEigen(action_gradient).array() * (Scalar(1) - ToEigen(actions).array().square())).matrix();
}

#define B4MRL_INSTANTIATE(Scalar)                                                                  \
  template void SampleSquashedGaussian<Scalar>(const SquashedGaussianOptions&,                     \
                                               MatrixView<const Scalar>, MatrixView<const Scalar>, \
                                               MatrixView<Scalar>, std::span<Scalar>);             \
  template void SquashedGaussianBackward<Scalar>(                                                  \
      const SquashedGaussianOptions&, MatrixView<const Scalar>, MatrixView<const Scalar>,          \
      MatrixView<const Scalar>, MatrixView<const Scalar>, Scalar, MatrixView<Scalar>);             \
  template void ScaleLogStd<Scalar>(MatrixView<const Scalar>, std::span<const Scalar>,             \
                                    MatrixView<Scalar>);                                           \
  template void ScaleLogStdBackward<Scalar>(MatrixView<const Scalar>, std::span<const Scalar>,     \
                                            MatrixView<Scalar>, std::span<Scalar>);                \
  template void TanhForward<Scalar>(MatrixView<const Scalar>, MatrixView<Scalar>);                 \
  template void TanhBackward<Scalar>(MatrixView<const Scalar>, MatrixView<const Scalar>,           \
                                     MatrixView<Scalar>);
B4MRL_INSTANTIATE(float)
B4MRL_INSTANTIATE(double)
#undef B4MRL_INSTANTIATE

}  // namespace b4mrl
