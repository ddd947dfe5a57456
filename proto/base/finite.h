// Tests whether floating-point numbers are finite, or stay so as float32.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <ranges>

namespace b4mrl {

// True if none of the floating-point numbers in `values` is NaN or infinite. Any thread.
template <std::ranges::input_range Range>
bool AllFinite(const Range& values) {
  return std::ranges::all_of(values, [](auto value) { return std::isfinite(value); });
}

// True if `value` stays finite when it is rounded to float32. Any thread.
inline bool FitsFloat32(double value) {
  return std::abs(value) <= static_cast<double>(std::numeric_limits<float>::max());  // NaN is not
}

// True if each of `values` stays finite when it is rounded to float32. Any thread.
template <std::ranges::input_range Range>
bool AllFitFloat32(const Range& values) {
  return std::ranges::all_of(values, [](double value) { return FitsFloat32(value); });
}

}  // namespace b4mrl
