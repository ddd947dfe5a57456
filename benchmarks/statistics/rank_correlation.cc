#include "benchmarks/statistics/rank_correlation.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

namespace b4mrl {
namespace {

// The value's rank, counted from 0 and doubled, so that means of ranks are whole numbers.
std::vector<int64_t> DoubledRanks(std::span<const double> values) {
  std::vector<double> sorted(values.begin(), values.end());
  std::sort(sorted.begin(), sorted.end());
  std::vector<int64_t> ranks;
  ranks.reserve(values.size());
  for (const double value : values) {
    const auto [first, last] = std::equal_range(sorted.begin(), sorted.end(), value);
    ranks.push_back((first - sorted.begin()) + (last - sorted.begin()) - 1);
  }
  return ranks;
}

std::optional<double> Ratio(int64_t product, int64_t square_x, int64_t square_y) {
  if (square_x == 0 || square_y == 0) return std::nullopt;
  return static_cast<double>(product) /
         (std::sqrt(static_cast<double>(square_x)) * std::sqrt(static_cast<double>(square_y)));
}

int Sign(double value) { return (value > 0) - (value < 0); }

}  // namespace

std::optional<double> Spearman(std::span<const double> x, std::span<const double> y) {
  const std::vector<int64_t> ranks_x = DoubledRanks(x), ranks_y = DoubledRanks(y);
  const auto mean = static_cast<int64_t>(x.size()) - 1;  // of the doubled ranks
  int64_t product = 0, square_x = 0, square_y = 0;
  for (size_t i = 0; i < x.size(); ++i) {
    product += (ranks_x[i] - mean) * (ranks_y[i] - mean);
    square_x += (ranks_x[i] - mean) * (ranks_x[i] - mean);
    square_y += (ranks_y[i] - mean) * (ranks_y[i] - mean);
  }
  return Ratio(product, square_x, square_y);
}

std::optional<double> Kendall(std::span<const double> x, std::span<const double> y) {
  int64_t product = 0, square_x = 0, square_y = 0;
  for (size_t i = 0; i < x.size(); ++i) {
    for (size_t j = 0; j < i; ++j) {
      const int order_x = Sign(x[i] - x[j]), order_y = Sign(y[i] - y[j]);
      product += order_x * order_y;
      square_x += order_x * order_x;
      square_y += order_y * order_y;
    }
  }
  return Ratio(product, square_x, square_y);
}

}  // namespace b4mrl
