// Which names the datasets of users may have: a name decides which dataset `b4mrl train` and the
// benchmarks find. Pure functions; any thread.
#pragma once

#include <string_view>

#include "proto/base/status.h"

namespace b4mrl {

// Refuses the names of the datasets that `b4mrl dataset make` makes by recipe, without a version
// and with any: a file "medium" or "medium-v7" would be found in the place of the published
// "medium-v0" by whoever asks for "HalfCheetah/medium". kInvalidArgument.
Status CheckIsNoLevel(std::string_view dataset);

}  // namespace b4mrl
