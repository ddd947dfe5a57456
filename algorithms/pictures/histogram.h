// Histograms of numbers that are read in two passes: the first finds their range, the second counts
// them in bins. Memory is that of the bins, however many numbers there are.
//
// NaN and infinite values are counted apart and belong to no bin. Thread rule: one thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

namespace b4mrl {

// Which numbers there are: the first pass.
class NumberRange {
 public:
  void Add(double value);

  // Of the finite numbers; without any, infinity and -infinity, and the mean is NaN.
  double low() const { return low_; }
  double high() const { return high_; }
  double mean() const { return sum_ / static_cast<double>(finite_); }
  uint64_t finite() const { return finite_; }
  uint64_t nans() const { return nans_; }
  uint64_t infinities() const { return infinities_; }
  uint64_t count() const { return finite_ + nans_ + infinities_; }
  // Whether finite numbers differ from each other.
  bool varies() const { return low_ < high_; }

 private:
  double low_ = std::numeric_limits<double>::infinity();
  double high_ = -std::numeric_limits<double>::infinity();
  double sum_ = 0;
  uint64_t finite_ = 0, nans_ = 0, infinities_ = 0;
};

// How many numbers lie in each of equal bins: the second pass.
class Histogram {
 public:
  // `bins` (at least 1) bins between two finite numbers, low < high.
  Histogram(double low, double high, size_t bins) : low_(low), high_(high), counts_(bins) {}
  // Counts a finite number in its bin: on an edge, the one on the right. A number that rounding
  // puts outside [low, high] counts in the nearest bin. Ignores what is not finite.
  void Add(double value);

  double low() const { return low_; }
  double high() const { return high_; }
  const std::vector<uint64_t>& counts() const { return counts_; }

 private:
  double low_, high_;
  std::vector<uint64_t> counts_;
};

}  // namespace b4mrl
