#include "algorithms/pictures/histogram.h"

#include <algorithm>
#include <cmath>

namespace b4mrl {

void NumberRange::Add(double value) {
  if (std::isnan(value)) {
    ++nans_;
  } else if (std::isinf(value)) {
    ++infinities_;
  } else {
    low_ = std::min(low_, value);
    high_ = std::max(high_, value);
    sum_ += value;
    ++finite_;
  }
}

void Histogram::Add(double value) {
  if (!std::isfinite(value)) return;
  const auto bins = static_cast<double>(counts_.size());
  const double bin = std::floor((value - low_) / (high_ - low_) * bins);
  ++counts_[static_cast<size_t>(std::clamp(bin, 0.0, bins - 1))];
}

}  // namespace b4mrl
