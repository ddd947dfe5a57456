// The algorithms that `b4mrl train` knows: one line each in list.cc.
#pragma once

#include <span>
#include <string_view>

#include "algorithms/base/learner.h"

namespace b4mrl {

std::span<const Algorithm> Algorithms();
// kUnknownName suggests the nearest known name.
Result<const Algorithm*> FindAlgorithm(std::string_view name);

}  // namespace b4mrl
