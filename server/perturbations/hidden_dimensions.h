// How hidden dimensions are written; for list.cc, which also answers which ones a set hides. Any
// thread.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "server/perturbations/list.h"

namespace b4mrl {

// "9+v-root-x", "y+vx+vy": indices, names and features in any order. Sorted, without repetition.
Result<std::vector<uint32_t>> ParseDimensions(std::string_view text, const EnvironmentSpec& spec);

}  // namespace b4mrl
