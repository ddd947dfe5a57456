#include "algorithms/nn/gaussian_head.h"

#include "algorithms/nn/products/strip.h"

namespace b4mrl {
namespace {

// value = softplus(x) = max(x, 0) + log(1 + exp(-|x|)); slope = the derivative of softplus, a
// sigmoid; rest = 1 - slope without cancellation. Nothing overflows: for x < -80 the slope is
// practically 0. (A second exponential vectorises, Eigen's select would not.)
template <typename Scalar>
void Softplus(const Strip<Scalar>& x, Strip<Scalar>& value, Strip<Scalar>& slope,
              Strip<Scalar>& rest) {
  value = x.max(Scalar(0)) + (-x.abs()).exp().log1p();
  rest = (-x.max(Scalar(-80))).exp();
  slope = (Scalar(1) + rest).inverse();
  rest *= slope;
}

// Strips with the intermediate results of the loss on one column range.
template <typename Scalar>
struct LossStrips {
  Strip<Scalar> upper, lower;  // max and min of `bounds`, repeated for every column
  Strip<Scalar> log_var;       // raw, later bounded log-variances
  Strip<Scalar> slope_upper, slope_lower;
  Strip<Scalar> rest_upper, rest_lower;  // Softplus's `rest` for the upper and lower bound
  Strip<Scalar> x, error, precision, d_log_var;
};

// log_var = lower + softplus(upper - softplus(upper - raw) - lower).
template <typename Scalar>
void Bound(LossStrips<Scalar>& s) {
  s.x = s.upper - s.log_var;
  Softplus<Scalar>(s.x, s.log_var, s.slope_upper, s.rest_upper);
  s.x = s.upper - s.log_var - s.lower;
  Softplus<Scalar>(s.x, s.log_var, s.slope_lower, s.rest_lower);
  s.log_var += s.lower;
}

// Adds to sums[k] the sum over columns of strip(k, column).
template <typename Scalar>
void AddRowSums(const Strip<Scalar>& strip, int rows, Scalar* sums) {
  const int columns = static_cast<int>(strip.size()) / rows;
  for (int i = 0; i < columns; ++i) {
    for (int k = 0; k < rows; ++k) sums[k] += strip[i * rows + k];
  }
}

// The loss on one column range, multiplied by n K of the whole batch.
template <typename Scalar>
double StripLoss(LossStrips<Scalar>& s, MatrixView<const Scalar> output,
                 MatrixView<const Scalar> targets, Scalar weight,
                 MatrixView<Scalar> output_gradient, std::span<Scalar> bounds_gradient) {
  const int outputs = targets.rows;
  Pack<Scalar>(output.RowBlock(0, outputs), s.error);
  Pack<Scalar>(targets, s.x);
  s.error -= s.x;
  Pack<Scalar>(output.RowBlock(outputs, outputs), s.log_var);
  Bound<Scalar>(s);
  s.precision = (-s.log_var).exp();
  s.x = s.error.square() * s.precision;
  const double loss = static_cast<double>((s.x + s.log_var).sum());
  s.d_log_var = weight * (Scalar(1) - s.x);
  s.error *= Scalar(2) * weight * s.precision;  // now d loss / d mean
  Unpack<Scalar>(s.error, output_gradient.RowBlock(0, outputs));
  s.x = s.d_log_var * s.rest_lower;
  AddRowSums<Scalar>(s.x, outputs, bounds_gradient.data() + outputs);
  s.d_log_var *= s.slope_lower;
  s.x = s.d_log_var * s.rest_upper;
  AddRowSums<Scalar>(s.x, outputs, bounds_gradient.data());
  s.d_log_var *= s.slope_upper;
  Unpack<Scalar>(s.d_log_var, output_gradient.RowBlock(outputs, outputs));
  return loss;
}

}  // namespace

template <typename Scalar>
double GaussianHeadLoss(MatrixView<const Scalar> output, MatrixView<const Scalar> targets,
                        std::span<const Scalar> bounds, MatrixView<Scalar> output_gradient,
                        std::span<Scalar> bounds_gradient) {
  const int outputs = targets.rows;
  const double count = static_cast<double>(outputs) * output.columns;
  double loss = 0;
  LossStrips<Scalar> strips;
  const int columns_per_strip = ColumnsPerStrip(outputs);
  for (int first = 0; first < output.columns; first += columns_per_strip) {
    const int columns = std::min(columns_per_strip, output.columns - first);
    Tile<Scalar>(bounds.first(outputs), columns, strips.upper);
    Tile<Scalar>(bounds.last(outputs), columns, strips.lower);
    loss += StripLoss<Scalar>(strips, output.ColumnBlock(first, columns),
                              targets.ColumnBlock(first, columns), static_cast<Scalar>(1 / count),
                              output_gradient.ColumnBlock(first, columns), bounds_gradient);
  }
  return loss / count;
}

template <typename Scalar>
void BoundLogVariances(std::span<const Scalar> bounds, MatrixView<Scalar> raw) {
  LossStrips<Scalar> strips;
  const int columns_per_strip = ColumnsPerStrip(raw.rows);
  for (int first = 0; first < raw.columns; first += columns_per_strip) {
    const int columns = std::min(columns_per_strip, raw.columns - first);
    Tile<Scalar>(bounds.first(raw.rows), columns, strips.upper);
    Tile<Scalar>(bounds.last(raw.rows), columns, strips.lower);
    Pack<Scalar>(raw.ColumnBlock(first, columns), strips.log_var);
    Bound<Scalar>(strips);
    Unpack<Scalar>(strips.log_var, raw.ColumnBlock(first, columns));
  }
}

template <typename Scalar>
void SampleGaussian(MatrixView<const Scalar> mean, MatrixView<const Scalar> log_var,
                    MatrixView<const Scalar> noise, MatrixView<Scalar> output) {
  Strip<Scalar> deviation, other;
  const int columns_per_strip = ColumnsPerStrip(mean.rows);
  for (int first = 0; first < mean.columns; first += columns_per_strip) {
    const int columns = std::min(columns_per_strip, mean.columns - first);
    Pack<Scalar>(log_var.ColumnBlock(first, columns), deviation);
    deviation = (Scalar(0.5) * deviation).exp();
    Pack<Scalar>(noise.ColumnBlock(first, columns), other);
    deviation *= other;
    Pack<Scalar>(mean.ColumnBlock(first, columns), other);
    deviation += other;
    Unpack<Scalar>(deviation, output.ColumnBlock(first, columns));
  }
}

#define B4MRL_INSTANTIATE(Scalar)                                                              \
  template double GaussianHeadLoss<Scalar>(MatrixView<const Scalar>, MatrixView<const Scalar>, \
                                           std::span<const Scalar>, MatrixView<Scalar>,        \
                                           std::span<Scalar>);                                 \
  template void BoundLogVariances<Scalar>(std::span<const Scalar>, MatrixView<Scalar>);        \
  template void SampleGaussian<Scalar>(MatrixView<const Scalar>, MatrixView<const Scalar>,     \
                                       MatrixView<const Scalar>, MatrixView<Scalar>);
B4MRL_INSTANTIATE(float)
B4MRL_INSTANTIATE(double)
#undef B4MRL_INSTANTIATE

}  // namespace b4mrl
