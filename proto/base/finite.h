// Tests whether floating-point numbers are finite.
#pragma once

#include <algorithm>
#include <cmath>
#include <ranges>

namespace b4mrl {

// True if none of the floating-point numbers in `values` is NaN or infinite. Any thread.
template <std::ranges::input_range Range>
bool AllFinite(const Range& values) {
  return std::ranges::all_of(values, [](auto value) { return std::isfinite(value); });
}

}  // namespace b4mrl
