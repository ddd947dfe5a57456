// Reads the argument of hidden=A+B+...; list.cc needs this to answer which dimensions a set hides.
// Any thread.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "server/perturbations/list.h"

namespace b4mrl {

// The dimension indices that `text` names ("9+v-root-x", "y+vx+vy": indices, names and features in
// any order), sorted and without repetition.
Result<std::vector<uint32_t>> ParseDimensions(std::string_view text, const EnvironmentSpec& spec);

}  // namespace b4mrl
