#include "benchmarks/statistics/significance.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include "proto/base/mean_and_std.h"

namespace b4mrl {
namespace {

// The probability that a Student t lies within (-t, t), t >= 0, by the finite sums of Abramowitz
// and Stegun, "Handbook of mathematical functions", 26.7.3 and 26.7.4.
double StudentWithin(double t, size_t degrees) {
  const double angle = std::atan(t / std::sqrt(static_cast<double>(degrees)));
  const double sine = std::sin(angle), cosine = std::cos(angle);
  const bool odd = degrees % 2 == 1;
  double term = odd ? cosine : 1, sum = 0;
  for (size_t i = odd ? 1 : 0; i + 1 < degrees; i += 2) {
    sum += term;
    term *= cosine * cosine * static_cast<double>(i + 1) / static_cast<double>(i + 2);
  }
  return odd ? 2 / std::numbers::pi * (angle + sine * sum) : sine * sum;
}

}  // namespace

double SignTestGreater(size_t positive, size_t negative) {
  const size_t count = positive + negative;
  // Binomial terms with probability 1/2, from `count` successes downwards.
  double term = std::exp2(-static_cast<double>(count)), sum = 0;
  for (size_t successes = count;; --successes) {
    sum += term;
    if (successes == positive) return std::min(1.0, sum);
    term *= static_cast<double>(successes) / static_cast<double>(count - successes + 1);
  }
}

double SignTestTwoSided(size_t positive, size_t negative) {
  const auto [fewer, more] = std::minmax(positive, negative);
  return std::min(1.0, 2 * SignTestGreater(more, fewer));
}

double StudentTwoSided(double t, size_t degrees) {
  return std::max(0.0, 1 - StudentWithin(std::abs(t), degrees));
}

double StudentQuantile(double p, size_t degrees) {
  // The distribution is symmetric: search the upper half, by doubling and then by halving.
  const double within = std::abs(2 * p - 1);
  double low = 0, high = 1;
  while (std::isfinite(high) && StudentWithin(high, degrees) < within) high *= 2;
  for (double middle = high / 2; low < middle && middle < high; middle = (low + high) / 2) {
    (StudentWithin(middle, degrees) < within ? low : high) = middle;
  }
  return p < 0.5 ? -low : low;
}

double NormalTwoSided(double z) { return std::erfc(std::abs(z) / std::numbers::sqrt2); }

Interval StudentInterval(std::span<const double> values, double confidence) {
  const auto [mean, std] = MeanAndStdOf(values);
  const double error = std / std::sqrt(static_cast<double>(values.size() - 1));
  const double half = StudentQuantile((1 + confidence) / 2, values.size() - 1) * error;
  return {mean - half, mean + half};
}

std::vector<double> HolmAdjusted(std::span<const double> p_values) {
  std::vector<size_t> order(p_values.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](size_t a, size_t b) { return p_values[a] < p_values[b]; });
  std::vector<double> adjusted(p_values.size());
  double largest = 0;
  for (size_t i = 0; i < order.size(); ++i) {
    const double scaled = p_values[order[i]] * static_cast<double>(order.size() - i);
    largest = std::max(largest, std::min(1.0, scaled));
    adjusted[order[i]] = largest;
  }
  return adjusted;
}

}  // namespace b4mrl
