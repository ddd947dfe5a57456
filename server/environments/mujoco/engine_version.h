// The version of MuJoCo, for experiment ids and snapshots. Any thread.
#pragma once

#include <string>

#include "proto/base/status.h"

namespace b4mrl {

// Name and version of the loaded library: "MuJoCo 2.2.2". Other versions may give other numbers.
std::string EngineVersion();

// kFailedPrecondition if the loaded library is not of the version whose headers this program was
// compiled with: it would read other structures than it was given.
Status CheckEngineVersion();

}  // namespace b4mrl
