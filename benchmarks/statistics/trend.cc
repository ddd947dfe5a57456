#include "benchmarks/statistics/trend.h"

#include <cstddef>
#include <vector>

#include "benchmarks/statistics/estimates.h"

namespace b4mrl {

std::optional<double> MedianSlope(std::span<const double> x, std::span<const double> y) {
  std::vector<double> slopes;
  for (size_t i = 0; i < x.size(); ++i) {
    for (size_t j = 0; j < i; ++j) {
      if (x[i] != x[j]) slopes.push_back((y[i] - y[j]) / (x[i] - x[j]));
    }
  }
  if (slopes.empty()) return std::nullopt;
  return Median(slopes);
}

}  // namespace b4mrl
