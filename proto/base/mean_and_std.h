// Mean and standard deviation of a list of numbers. Pure functions; any thread.
#pragma once

#include <cmath>
#include <numeric>
#include <span>

namespace b4mrl {

struct MeanAndStd {
  double mean = 0;
  double std = 0;  // of the population: divided by the number of values
};

// `values` has at least one entry.
inline MeanAndStd MeanAndStdOf(std::span<const double> values) {
  const auto count = static_cast<double>(values.size());
  MeanAndStd result;
  result.mean = std::accumulate(values.begin(), values.end(), 0.0) / count;
  double squares = 0;
  for (const double value : values) squares += (value - result.mean) * (value - result.mean);
  result.std = std::sqrt(squares / count);
  return result;
}

}  // namespace b4mrl
