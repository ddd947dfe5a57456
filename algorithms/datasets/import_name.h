// Which names the datasets of users may have: a name decides which dataset `b4mrl train` and the
// benchmarks find, and may tell the environment. Pure functions; any thread.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "proto/base/status.h"

namespace b4mrl {

// Refuses the names of the datasets that `b4mrl dataset make` makes by recipe, without a version
// and with any: a file "medium" or "medium-v7" would be found in the place of the published
// "medium-v0" by whoever asks for "HalfCheetah/medium". kInvalidArgument.
Status CheckIsNoLevel(std::string_view dataset);

// Whether it names a file of D4RL's, "d4rl/halfcheetah-medium-v2".
bool IsOfD4rl(std::string_view dataset);

// The one of `environments` that the name belongs to, "HalfCheetah" for "HalfCheetah/mine" and for
// "d4rl/halfcheetah-medium-v2"; "" for a name of a foreign environment, which is allowed.
// kUnknownName if the name is nearly that of an environment, as "halfcheetah/mine": its rows would
// belong to none.
Result<std::string> EnvironmentOfImport(std::string_view dataset,
                                        const std::vector<std::string>& environments);

}  // namespace b4mrl
