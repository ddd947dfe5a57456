#include "benchmarks/statistics/significance.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

namespace b4mrl {
namespace {

constexpr double kNearlyNormal = 1e7;  // degrees of freedom

// The regularised incomplete beta function of x in [0, 1], given with y = 1 - x, which rounding
// would spoil; by the continued fraction of the "NIST digital library of mathematical functions",
// 8.17.22, from its innermost term outwards.
double IncompleteBeta(double x, double y, double a, double b) {
  if (x <= 0 || y <= 0) return x <= 0 ? 0 : 1;
  // The fraction converges fast up to about the mean of the beta distribution.
  if (x > (a + 1) / (a + b + 2)) return 1 - IncompleteBeta(y, x, b, a);
  constexpr int kPairs = 200;
  double fraction = 1;
  for (int m = kPairs; m >= 0; --m) {
    const double odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1));
    fraction = 1 + odd / fraction;
    if (m == 0) break;
    fraction = 1 + m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m)) / fraction;
  }
  const double logarithm =
      a * std::log(x) + b * std::log(y) + std::lgamma(a + b) - std::lgamma(a) - std::lgamma(b);
  return std::exp(logarithm) / (a * fraction);
}

// The probability that a Student t lies within (-t, t), t >= 0.
double StudentWithin(double t, size_t degrees) {
  return 1 - StudentTwoSided(t, static_cast<double>(degrees));
}

}  // namespace

double ChanceOfAtLeast(size_t count, std::span<const double> chances) {
  // The probabilities of 0, 1, ... events among those seen so far.
  std::vector<double> probabilities = {1};
  for (const double chance : chances) {
    probabilities.push_back(0);
    for (size_t i = probabilities.size() - 1; i > 0; --i) {
      probabilities[i] += (probabilities[i - 1] - probabilities[i]) * chance;
    }
    probabilities[0] *= 1 - chance;
  }
  double sum = 0;
  for (size_t i = probabilities.size(); i > count; --i) sum += probabilities[i - 1];
  return std::min(1.0, sum);
}

double StudentTwoSided(double t, double degrees) {
  if (std::isinf(t)) return 0;
  // Beyond, the two distributions agree to 1e-7, and the logarithms of the beta function do not.
  if (degrees > kNearlyNormal) return NormalTwoSided(t);
  const double sum = degrees + t * t;
  return IncompleteBeta(degrees / sum, t * t / sum, degrees / 2, 0.5);
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
